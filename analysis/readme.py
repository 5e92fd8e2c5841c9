"""What the studies' scripts share: short numbers, tables in Markdown, and the places in a README that they are put into."""

import re


def short(number, digits):
    """At most so many significant digits; exponents without a plus or leading zeros."""
    if number is None:
        return "empty"
    if number == 0:
        return "0"
    return f"{number:.{digits}g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def table(header, rows, align=None):
    """A table whose first column is words and whose other columns are numbers, unless `align` says otherwise."""
    align = align or ["--"] + ["--:"] * (len(header) - 1)
    lines = ["| " + " | ".join(header) + " |", "|" + "|".join(align) + "|"]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows])


def put(path, name, text):
    """Replaces what stands between the markers `<!-- name -->` and `<!-- /name -->` of a file."""
    page = path.read_text()
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.S)
    assert pattern.search(page), name
    path.write_text(pattern.sub(lambda found: found[1] + text + "\n" + found[2], page))
