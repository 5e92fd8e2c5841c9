"""Charts as SVG: lines over a linear or logarithmic x, and bars of a logarithmic length."""

import math
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 720, 340
FONT = 'font-family="DejaVu Sans, Arial, sans-serif" font-size="12"'
# Okabe & Ito's colours, which stay apart for colour-blind eyes.
COLORS = {
    "viewplane": "#e69f00", "viewpoint": "#56b4e9", "perspective": "#009e73", "spherical": "#cc79a7", "sheet": "#0072b2",
    "slab": "#d55e00", "reference": "#000000",
}


def color(name):
    return COLORS.get(name, "#888888")


def page(parts, height=HEIGHT):
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" {FONT}>'
    return "\n".join([head, f'<rect width="{WIDTH}" height="{height}" fill="white"/>', *parts, "</svg>"]) + "\n"


def label(x, y, words, anchor="start", more=""):
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(words)}</text>'


def ticks(low, high, count=6):
    step = 10 ** math.floor(math.log10((high - low) / count))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (step * m) <= count)
    first = math.ceil(low / step - 1e-9)
    return [i * step for i in range(first, math.floor(high / step + 1e-9) + 1)]


def number(value):
    if value and (abs(value) < 1e-3 or abs(value) >= 1e4):
        return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.6g}"


def lines(title, x_words, y_words, series, log_x=False, log_y=None):
    """`series`: (name, [(x, y)]), the first drawn first; `log_y`: the least value of a logarithmic axis."""
    left, right, top, bottom = 70, 150, 34, 46
    width, height = WIDTH - left - right, HEIGHT - top - bottom
    points = [point for _, line in series for point in line]
    xs = [math.log10(x) if log_x else x for x, _ in points]
    x_low, x_high = min(xs), max(xs)
    if log_y:
        y_low, y_high = math.log10(log_y), math.ceil(math.log10(max(y for _, y in points)))
    else:
        ys = [y for _, y in points]
        room = 0.06 * (max(ys) - min(ys) or 1)
        y_low, y_high = min(ys) - room, max(ys) + room
    at_x = lambda x: left + width * ((math.log10(x) if log_x else x) - x_low) / (x_high - x_low)
    at_y = lambda y: top + height * (1 - ((math.log10(max(y, log_y)) if log_y else y) - y_low) / (y_high - y_low))
    parts = [label(left, 20, title, more='font-weight="bold"')]
    for x in ([10.0 ** i for i in range(math.ceil(x_low), math.floor(x_high) + 1)] if log_x else ticks(x_low, x_high)):
        parts.append(f'<path d="M{at_x(x):.1f} {top}v{height}" stroke="#dddddd"/>')
        parts.append(label(at_x(x), top + height + 16, number(x), "middle"))
    for y in ([10.0 ** i for i in range(math.ceil(y_low), y_high + 1)] if log_y else ticks(y_low, y_high)):
        parts.append(f'<path d="M{left} {at_y(y):.1f}h{width}" stroke="#dddddd"/>')
        parts.append(label(left - 6, at_y(y) + 4, number(y), "end"))
    parts.append(label(left + width / 2, HEIGHT - 10, x_words, "middle"))
    parts.append(label(0, 0, y_words, "middle", f'transform="translate(16 {top + height / 2:.0f}) rotate(-90)"'))
    for i, (name, line) in enumerate(series):
        path = "M" + "L".join(f"{at_x(x):.1f} {at_y(y):.1f}" for x, y in line)
        wide = 5 if name == "reference" else 1.6
        faint = ' stroke-opacity="0.3"' if name == "reference" else ""
        dash = "" if name in COLORS else ' stroke-dasharray="5 3"'
        shade = color(name) if name in COLORS else ["#888888", "#555555"][i % 2]
        parts.append(f'<path d="{path}" fill="none" stroke="{shade}" stroke-width="{wide}"{faint}{dash}/>')
        y = top + 10 + 20 * i
        parts.append(f'<path d="M{left + width + 12} {y}h22" stroke="{shade}" stroke-width="{wide}"{faint}{dash}/>')
        parts.append(label(left + width + 40, y + 4, name))
    return page(parts)


def bars(title, x_words, groups, limit):
    """`groups`: (name, value); `limit`: a line across the bars."""
    left, right, top, bottom, step = 190, 70, 34, 46, 26
    width, height = WIDTH - left - right, step * len(groups)
    found = [value for _, value in groups if value > 0]
    low = min(-8, math.floor(math.log10(limit)))
    high = max([0, *(math.ceil(math.log10(value)) for value in found)])
    at = lambda value: left + width * (max(math.log10(value), low) - low) / (high - low) if value > 0 else left
    parts = [label(14, 20, title, more='font-weight="bold"')]
    for i in range(low, high + 1):
        parts.append(f'<path d="M{at(10.0 ** i):.1f} {top}v{height}" stroke="#dddddd"/>')
        parts.append(label(at(10.0 ** i), top + height + 16, number(10.0 ** i), "middle"))
    for i, (name, value) in enumerate(groups):
        y = top + step * i
        parts.append(f'<rect x="{left}" y="{y + 5}" width="{at(value) - left:.1f}" height="{step - 10}" fill="{color(name)}"/>')
        parts.append(label(left - 8, y + step / 2 + 4, name, "end"))
        parts.append(label(at(value) + 6, y + step / 2 + 4, f"{value:.2g}"))
    parts.append(f'<path d="M{at(limit):.1f} {top}v{height}" stroke="#cc0000" stroke-dasharray="4 3"/>')
    parts.append(label(left + width / 2, top + height + 38, f"{x_words}; dashed: what counts as right", "middle"))
    return page(parts, top + height + bottom)
