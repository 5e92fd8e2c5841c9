#!/usr/bin/env python3
"""Error surfaces: charts of the paper's figures, its claims as numbers, stability, the inverse question, speed.

    cargo build --release
    python3 analysis/error-surfaces/run.py              # a minute; rewrites this folder's charts, CSVs and README's tables
    python3 analysis/error-surfaces/run.py --no-speed   # keeps the speed measured before
"""

import csv
import json
import math
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# The modules that the studies share leave nothing behind.
sys.dont_write_bytecode = True
sys.path.append(str(HERE.parent))
import readme  # noqa: E402
from readme import table  # noqa: E402

PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "stereomist"
STUDY = tomllib.loads((HERE / "study.toml").read_text())
RESULTS = []


def run(*arguments):
    done = subprocess.run([PROGRAM, "errors", *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{arguments}: {done.stderr}")
    return done.stdout


def record(part, case, what, value, unit=""):
    RESULTS.append([part, case, what, repr(value) if isinstance(value, float) else value, unit])
    return value


def value(c, form="closed", of="projection", component="x", **options):
    """One cell; None where it is empty."""
    settings = {key: STUDY["claims"][key] for key in ("radius", "near", "interocular")} | options
    words = [f"--{key.replace('_', '-')}={item}" for key, item in settings.items()]
    x, y, z = c
    text = run("--of", of, "--component", component, f"--x={x}:{x}:1", f"--y={y}", f"--z={z}:{z}:1", "--form", form, *words)
    cell = text.splitlines()[1].split(",")[3]
    return float(cell) if cell else None


def put(name, text):
    readme.put(HERE / "README.md", name, text)


def short(number, digits=3):
    return readme.short(number, digits)


def figures():
    names = {"projection": "e", "parallax": "parallax"}
    rows = []
    for number in STUDY["figures"]:
        run("--figure", number, "--plot", HERE / f"figure-{number}.png")
        report = json.loads(run("--figure", number, "--json"))
        what = f"{names[report['of']]}_{report['component']}"
        for form in report["forms"]:
            cells = []
            for end in ("least", "greatest"):
                at = form[end]
                record("figures", f"figure {number}", f"{form['form']} {end}", at["value"], "scene units")
                cells.append(f"{short(at['value'])} at ({', '.join(short(x) for x in at['center'])})")
            plane = "C_x, C_z" if number in (4, 8, 10, 12) else "C_x, C_y"
            rows.append([f"[{number}](figure-{number}.png)", f"{what} over {plane}", form["form"], *cells])
    put("figures", table(["figure", "surface", "form", "least", "greatest"], rows, ["--"] * 5))


def claims():
    """Numbers behind the findings, which the README's sentences name."""
    corner, corner_left = {"point": "corner"}, {"point": "-1,1"}

    def ask(name, c, **options):
        record("claims", name, f"C = {c}", value(c, **options), "scene units")

    for d in (1, 2, 4, 6):
        for form in ("closed", "printed"):
            ask(f"e_x at C_x = 2, d = {d}, {form}", (2, 0, -d), form=form)
    for x in (-2, -1, -0.5, 0, 0.5, 1, 2):
        for form in ("closed", "printed"):
            ask(f"e_x at C_x = {x}, d = 2, {form}", (x, 0, -2), form=form)
    for y in (0, 2):
        ask(f"e_x of E at C_y = {y}", (1, y, -2))
        ask(f"e_x of the corner at C_y = {y}", (1, y, -2), **corner)
    for form in ("closed", "printed"):
        ask(f"e_y of E at C_x = 0, {form}", (0, 1, -2), component="y", form=form)
        ask(f"e_y of E at C_y = 0, {form}", (1, 0, -2), component="y", form=form)
        for component in "xy":
            ask(f"parallax {component} at C = (0, 1, -2), {form}", (0, 1, -2), of="parallax", component=component, form=form)
            ask(f"parallax {component} at C = (0, 1, -6), {form}", (0, 1, -6), of="parallax", component=component, form=form)
            ask(f"parallax {component} at C = (2, 1, -2), {form}", (2, 1, -2), of="parallax", component=component, form=form)
            ask(f"parallax {component} at C = (2, 1, -6), {form}", (2, 1, -6), of="parallax", component=component, form=form)
    ask("e_y of the corner at C_x = 0", (0, 1, -2), component="y", **corner)
    ask("e_y of the corner at C_y = 0", (1, 0, -2), component="y", **corner)
    ask("e_y of the top edge at C_x = 0", (0, 1, -2), component="y", point="top-edge")
    ask("e_x of the upper left corner at C = (1, 1, -2)", (1, 1, -2), **corner_left)
    ask("e_x of the corner at C = (1, 1, -2)", (1, 1, -2), **corner)
    ask("e_y of the corner at C = (1, 1, -2)", (1, 1, -2), component="y", **corner)
    ask("e_x of E at C = (1, 1, -2)", (1, 1, -2))
    ask("e_y of E at C = (1, 1, -2)", (1, 1, -2), component="y")
    for between in STUDY["solve"]["between"]:
        for r, d in ((0.5, 2), (0.45, 6)):
            ask(f"{between} at C = (d/2, 0, -d), d = {d}, r = {r}", (d / 2, 0, -d), between=between, radius=r)
            ask(f"{between} at C = (0, 0, -d), d = {d}, r = {r}", (0, 0, -d), between=between, radius=r)


def seen():
    """What somebody in front of the picture sees of it, at the corner of a particle of the paper's fog."""
    frame = STUDY["frame"]
    options = {"size": "x".join(map(str, frame["size"])), "radius": 0.45, "point": "corner"}
    viewer = {"viewer_distance": frame["viewer_distance"], "screen_width": frame["screen_width"]}
    rows = []
    for d in frame["depths"]:
        for x in frame["tangents"]:
            c, row = (x * d, 0.2 * d, -d), [d, x]
            for of in ("projection", "parallax"):
                for component in "xy":
                    for unit, more in (("px", {}), ("arcmin", viewer)):
                        error = value(c, of=of, component=component, unit=unit, **options, **more)
                        what = f"{of} {component} of the corner, r = 0.45, C = ({x} d, 0.2 d, -d), d = {d}"
                        record("seen", what, unit, error, unit)
                        row.append(short(error))
            rows.append(row)
    header = ["distance d", "C_x / d"]
    for of in ("projection", "parallax"):
        for component in "xy":
            header += [f"{of} {component}, px", "arcmin"]
    put("seen", table(header, rows))


def solve():
    part = STUDY["solve"]
    rows = []
    for between in part["between"]:
        for tolerance in part["tolerance"]:
            cells = []
            for fov in part["fov_y_deg"]:
                text = run("--solve", f"tolerance={tolerance}", "--radius", part["radius"], "--between", between,
                           "--fov-y-deg", fov, "--size", "x".join(map(str, STUDY["frame"]["size"])), "--json")
                answer = json.loads(text)["solve"]
                record("solve", f"{between}, {tolerance}, {fov} degrees", "distance", answer["distance"], "scene units")
                cells.append(short(answer["distance"]))
            rows.append([between.replace(",", " against "), tolerance, *cells])
    put("solve", table(["", "tolerance", *(f"{fov}°" for fov in part["fov_y_deg"])], rows, ["--"] + ["--:"] * 5))


def stability():
    """Every question of the table, asked of the command itself."""
    with open(ROOT / STUDY["stability"]["questions"], newline="") as file:
        questions = list(csv.DictReader(file))
    answers = ["numeric_f32", "numeric_f64", "printed_f32", "printed_f64", "closed_f32", "closed_f64"]
    kept, worst = [], {}
    for q in questions:
        exact = float(q["exact"]) if q["exact"] else None
        as_printed = float(q["printed"]) if q["printed"] else None
        out = dict(q)
        forms = ["numeric", "closed"] + (["printed"] if (q["first"], q["second"], float(q["a"]), float(q["b"])) ==
                                         ("viewplane", "viewpoint", 1, 0) else [])
        for precision in ("f32", "f64"):
            cells = run("--of", q["of"], "--component", q["component"], "--between", f"{q['first']},{q['second']}",
                        f"--point={q['a']},{q['b']}", f"--x={q['cx']}:{q['cx']}:1", f"--y={q['cy']}",
                        f"--z={q['cz']}:{q['cz']}:1", "--radius", q["radius"], "--near", q["near"],
                        "--interocular", q["interocular"], "--precision", precision,
                        "--form", ",".join(forms)).splitlines()[1].split(",")[3:]
            for form, cell in zip(forms, cells):
                out[f"{form}_{precision}"] = cell
        for name in answers:
            truth = as_printed if name.startswith("printed") else exact
            cell = out.get(name)
            if cell is None or truth is None:
                error = "no formula" if cell is None else ("empty" if cell == "" else "no such value")
            elif cell == "":
                error = "lost"
            else:
                error = abs(float(cell) - truth) / abs(truth) if truth else abs(float(cell))
            out[f"error_{name}"] = error if isinstance(error, str) else f"{error:.2e}"
            entry = worst.setdefault(q["case"], {}).setdefault(name, [0.0, 0, 0])
            if isinstance(error, float):
                entry[0] = max(entry[0], error)
            elif error == "lost":
                entry[1] += 1
            elif error == "no such value":
                entry[2] += 1
        # The printed form against the definition: not rounding but another formula.
        if as_printed is not None and exact:
            out["printed_against_definition"] = f"{abs(as_printed - exact) / abs(exact):.2e}"
        kept.append(out)
        worst[q["case"]].setdefault("condition", []).append(float(q["condition"]) if q["condition"] else math.inf)
        worst[q["case"]].setdefault("none", []).append(exact is None)
        if exact and as_printed is not None:
            worst[q["case"]].setdefault("other", []).append(abs(as_printed - exact) / abs(exact))
        if exact and q["condition"] != "+inf":
            error = out["error_closed_f32"]
            part = 1.0 if error == "lost" else float(error) / float(q["condition"])
            worst[q["case"]]["of condition"] = max(worst[q["case"]].get("of condition", 0.0), part)
    fields = list(questions[0]) + [key for name in answers for key in (name, f"error_{name}")] + ["printed_against_definition"]
    with open(HERE / "stability.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fields, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(kept)
    rows = []
    for case, entry in worst.items():
        def cell(name):
            error, lost, invented = entry[name]
            return short(error, 2) + (f", {lost} empty" if lost else "") + (f", {invented} invented" if invented else "")
        finite = [c for c in entry["condition"] if c < math.inf]
        rows.append([case, len(entry["none"]), sum(entry["none"]), short(max(finite), 2), cell("numeric_f32"),
                     cell("numeric_f64"), cell("printed_f32"), cell("printed_f64"),
                     short(max(entry.get("other", [0])), 2), cell("closed_f32"),
                     cell("closed_f64"), short(entry["of condition"], 2)])
        for name in answers:
            record("stability", case, f"largest relative error, {name}", entry[name][0])
    put("stability", table(["case", "rows", "no such point", "condition up to", "numeric f32", "numeric f64",
                            "printed f32, rounding", "printed f64, rounding", "printed, as a formula", "closed f32", "closed f64",
                            "closed f32 over condition"], rows))


def speed():
    words = [PROGRAM, "errors", *STUDY["speed"]["grid"].split(), "-o", "/dev/null"]
    times = []
    for _ in range(1 + STUDY["speed"]["repeats"]):
        start = time.perf_counter()
        subprocess.run(words, check=True)
        times.append(time.perf_counter() - start)
    seconds = statistics.median(times[1:])
    # Peak of the children; nothing else that ran here is anywhere near it in cells.
    child = subprocess.Popen(words)
    _, _, usage = os.wait4(child.pid, 0)
    megabytes = usage.ru_maxrss / 1024
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "?")
    family = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("cpu family")), "?")
    record("speed", "100,000,000 cells, closed, f64, to /dev/null", "median wall time", round(seconds, 3), "s")
    record("speed", "100,000,000 cells, closed, f64, to /dev/null", "peak resident memory", round(megabytes, 1), "MB")
    put("speed", f"{seconds:.2f} s (median of {STUDY['speed']['repeats']}; fastest {min(times[1:]):.2f} s, slowest "
                 f"{max(times[1:]):.2f} s) and {megabytes:.0f} MB of memory at most, on {model} (family {family}), "
                 f"{os.cpu_count()} cores, {platform.system()} {platform.machine()}.")


def main():
    figures()
    claims()
    seen()
    solve()
    stability()
    kept = []
    if "--no-speed" in sys.argv:
        with open(HERE / "results.csv", newline="") as file:
            kept = [row for row in csv.reader(file) if row[0] == "speed"]
    else:
        speed()
    with open(HERE / "results.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["part", "case", "what", "value", "unit"])
        writer.writerows(RESULTS + kept)


main()
