#!/usr/bin/env python3
"""Stability: every method where renderers of gas fail, beside the reference; a verdict for each.

    cargo build --release
    python3 analysis/stability/run.py      # two minutes; rewrites this folder's charts, results.csv and README's tables

Needs Python 3.11 and numpy.
"""

import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
# The modules beside this file, and those that the studies share, leave nothing behind.
sys.dont_write_bytecode = True
sys.path.append(str(HERE.parent))
import exr  # noqa: E402
import readme  # noqa: E402
import svg  # noqa: E402
from readme import table  # noqa: E402

ROOT = HERE.parent.parent
SCENES = ROOT / "scenes" / "stability"
PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "stereomist"
STUDY = tomllib.loads((HERE / "study.toml").read_text())
METHODS = STUDY["methods"]
TRUTH = "reference"
RESULTS = []
VERDICTS = {}
SCRATCH = tempfile.TemporaryDirectory()
PLACES = iter(range(10**9))


class Refused(Exception):
    """The program's own words."""


def render(scene, method, *settings, planes=True):
    """Pictures by eye, each a dictionary of planes R, G, B, A and, from the reference, E; without `planes` the folder."""
    path = scene if isinstance(scene, Path) else SCENES / f"{scene}.toml"
    folder = Path(SCRATCH.name) / str(next(PLACES))
    # One format for one view, two for two.
    stereo = "[stereo]" in path.read_text()
    words = [PROGRAM, "render", path, "-o", folder, "--image", "exr", "--method", method, "--tolerance", "0", "--threads", "1",
             "--quiet", "--format", "left,right" if stereo else "mono"]
    for setting in settings:
        words += ["--set", setting]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0:
        raise Refused(done.stderr.strip())
    eyes = ["left", "right"] if stereo else ["mono"]
    files = {eye: folder / f"{path.stem}.{eye}.exr" for eye in eyes}
    if not planes:
        return files
    pictures = {eye: exr.read(file) for eye, file in files.items()}
    for file in folder.iterdir():
        file.unlink()
    return pictures


def renders(requests):
    """Pictures of many (scene, method, setting, ...), two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda request: render(*request), requests))


def color(picture):
    return np.stack([picture[name] for name in "RGB"]).astype(np.float64)


def mono(pictures):
    return color(pictures["mono"])


def middle(pictures, name="A"):
    plane = pictures["mono"][name]
    return float(plane[plane.shape[0] // 2, plane.shape[1] // 2])


def largest(difference):
    return float(np.abs(difference).max())


def vector(values):
    return "[" + ",".join(repr(float(value)) for value in values) + "]"


def spaced(low, high, count):
    return [low + (high - low) * i / (count - 1) for i in range(count)]


def record(row, method, what, value):
    RESULTS.append([row, method, what, repr(value) if isinstance(value, float) else value])
    return value


def judge(row, method, value, what):
    """Right up to the row's limit; else degraded by the value."""
    limit = STUDY[row]["right"]
    verdict = "right" if value <= limit else f"degraded {short(value)}"
    VERDICTS[row, method] = verdict
    record(row, method, what, value)
    record(row, method, "verdict", verdict)


def short(number, digits=2):
    return readme.short(number, digits)


def put(name, text):
    readme.put(HERE / "README.md", name, text)


def chart(name, text):
    assert len(text) < 100_000, name
    (HERE / f"{name}.svg").write_text(text)


def bars(row, words, values):
    chart(row.replace("_", "-"), svg.bars(STUDY[row]["what"], words, values, STUDY[row]["right"]))


def bound(row, pictures):
    """The reference's own bound over the pictures of a row: its verdict."""
    worst = max(float(eye["E"].max()) for picture in pictures for eye in picture.values())
    judge(row, TRUTH, worst, "largest bound of its own error")
    return worst


# ---- Rows


def orbit(angle, extra=()):
    radians = math.radians(angle)
    return ["camera.position=" + vector([4 * math.sin(radians), 0, 4 * math.cos(radians)]), *extra]


def turn(angle, extra=()):
    radians = math.radians(angle)
    return ["camera.look_at=" + vector([math.sin(radians), 0, -math.cos(radians)]), *extra]


def popping():
    part = STUDY["popping"]
    half = part["step_deg"] / 2
    moves = {"orbit": orbit, "turn": turn}
    jumps, rows = {}, {m: [m] for m in METHODS[:-1]}
    colors = np.array([[1.0, 0.2, 0.0], [0.0, 0.3, 1.0]])
    for scene, move in moves.items():
        # Steps before, over and after the flip.
        steps = {}
        for m in METHODS:
            frames = [mono(p) for p in renders([(scene, m, *move(k * half)) for k in (-3, -1, 1, 3)])]
            steps[m] = [b - a for a, b in zip(frames, frames[1:])]
        record("popping", TRUTH, f"{scene}: largest change", largest(steps[TRUTH][1]))
        for m in METHODS[:-1]:
            before, over, after = steps[m]
            beyond = largest(over - steps[TRUTH][1])
            record("popping", m, f"{scene}: largest change beyond the reference's", beyond)
            # Equation 4 at every pixel, from the opacity of each particle alone.
            alone = [render(scene, m, *move(0.0, [f"particles.{hidden}.opacity=0.0"]))["mono"]["A"].astype(np.float64)
                     for hidden in (1, 0)]
            law = alone[0] * alone[1] * np.abs(colors[0] - colors[1])[:, None, None]
            # What motion alone would do is the mean of the steps beside it, except where a rim passes over a pixel.
            jump = np.where(np.minimum(*alone) > part["rim"], over - (before + after) / 2, 0.0)
            law = np.where(np.minimum(*alone) > part["rim"], law, 0.0)
            jumps[m, scene] = record("popping", m, f"{scene}: largest jump", largest(jump))
            off = record("popping", m, f"{scene}: largest difference of the jump from equation 4", largest(np.abs(jump) - law))
            record("popping", m, f"{scene}: equation 4's largest jump", largest(law))
            flips = jumps[m, scene] > 0.01
            rows[m] += [short(jumps[m, scene]), short(largest(law), 3) if flips else "", short(off) if flips else "", short(beyond)]
        series = []
        for m in [TRUTH, *METHODS[:-1]]:
            angles = spaced(*part["sweep_deg"])
            pictures = renders([(scene, m, *move(a)) for a in angles])
            series.append((m, [(a, middle(p, "B")) for a, p in zip(angles, pictures)]))
        words = {"orbit": "going round the particles", "turn": "turning in place"}[scene]
        chart(f"popping-{scene}", svg.lines(f"Blue in the middle of the picture, {words}", "angle, degrees", "blue", series))
    for m in METHODS[:-1]:
        judge("popping", m, max(jumps[m, "orbit"], jumps[m, "turn"]), "larger jump of both")
    put("popping", table(["", *(f"{move}: {what}" for move in ("going round", "turning")
                                for what in ("jump", "equation 4", "off by", "beyond the reference's change"))], rows.values()))
    bound("popping", renders([(scene, TRUTH, *move(half)) for scene, move in moves.items()]))


def ties():
    swap = ["particles.0.opacity=0.8", "particles.0.color=[0.0,0.3,1.0]", "particles.1.opacity=0.6",
            "particles.1.color=[1.0,0.2,0.0]"]
    pictures = {m: renders([("ties", m), ("ties", m, *swap)]) for m in METHODS}
    truth = mono(pictures[TRUTH][0])
    rows, values = [], []
    for m in METHODS[:-1]:
        error = largest((mono(pictures[m][0]) - truth)[:, 16, 16])
        swapped = record("ties", m, "largest change when the particles swap their indices",
                         largest(mono(pictures[m][0]) - mono(pictures[m][1])))
        judge("ties", m, error, "error of the middle pixel")
        shown = mono(pictures[m][0])[:, 16, 16]
        for name, value in zip("RGB", shown):
            record("ties", m, f"middle pixel {name}", float(value))
        rows.append([m, ", ".join(f"{v:.3f}" for v in shown), short(error), short(swapped)])
        values.append((m, error))
    shown = truth[:, 16, 16]
    for name, value in zip("RGB", shown):
        record("ties", TRUTH, f"middle pixel {name}", float(value))
    rows.append([TRUTH, ", ".join(f"{v:.3f}" for v in shown), "", short(largest(truth - mono(pictures[TRUTH][1])))])
    put("ties", table(["", "middle pixel, R G B", "error", "change when the indices swap"], rows))
    bars("ties", "error of the middle pixel", values)
    bound("ties", pictures[TRUTH])


def rivalry():
    pictures = dict(zip(METHODS, renders([("rivalry", m) for m in METHODS])))
    between = {m: color(p["right"]) - color(p["left"]) for m, p in pictures.items()}
    rows, values = [], []
    for m in METHODS:
        left, right = (color(pictures[m][eye])[:, 16, 16] for eye in ("left", "right"))
        for eye, shown in (("left", left), ("right", right)):
            for name, value in zip("RGB", shown):
                record("rivalry", m, f"middle pixel, {eye} eye, {name}", float(value))
        cells = [", ".join(f"{v:.3f}" for v in shown) for shown in (left, right)]
        if m != TRUTH:
            excess = largest(between[m] - between[TRUTH])
            judge("rivalry", m, excess, "largest difference between the eyes beyond the reference's")
            values.append((m, excess))
            cells.append(short(excess))
        rows.append([m, *cells])
    put("rivalry", table(["", "left eye, R G B", "right eye, R G B", "beyond the reference's"], rows))
    bars("rivalry", "difference between the eyes beyond the reference's", values)
    bound("rivalry", [pictures[TRUTH]])


def sweep(row, scene, places, setting, words, shown):
    """Changes from frame to frame beside the reference's: `shown` places of the chart."""
    changes, errors, bounds = {}, {}, []
    truths = renders([(scene, TRUTH, *setting(z)) for z in places])
    for m in METHODS:
        pictures = truths if m == TRUTH else renders([(scene, m, *setting(z)) for z in places])
        changes[m] = [largest(mono(b) - mono(a)) for a, b in zip(pictures, pictures[1:])]
        errors[m] = max(largest(mono(p) - mono(t)) for p, t in zip(pictures, truths))
    rows = []
    most = record(row, TRUTH, "largest change from frame to frame", max(changes[TRUTH]))
    for m in METHODS[:-1]:
        beyond = [a - b for a, b in zip(changes[m], changes[TRUTH])]
        worst = max(range(len(beyond)), key=beyond.__getitem__)
        at = record(row, m, "where", places[worst + 1])
        record(row, m, "largest change from frame to frame", max(changes[m]))
        record(row, m, "largest error", errors[m])
        judge(row, m, max(beyond[worst], 0.0), "largest change from frame to frame beyond the reference's")
        rows.append([m, short(max(changes[m])), short(max(beyond[worst], 0.0)), f"{at:.2f}", short(errors[m])])
    rows.append([TRUTH, short(most), "", "", ""])
    put(row, table(["", "largest change of a frame", "beyond the reference's", f"at {words}", "largest error"], rows))
    series = [(m, list(zip(places[1:], changes[m]))) for m in [TRUTH, *METHODS[:-1]]]
    chart(row, svg.lines(f"Largest change from one frame to the next: {STUDY[row]['what']}", shown, "change", series, log_y=1e-4))
    bound(row, truths)


def walk():
    sweep("walk", "walk", spaced(*STUDY["walk"]["z"]), lambda z: [f"camera.position=[0.0,0.0,{z!r}]"], "eye's z",
          "z of the eye, which walks to the left")


def wall():
    sweep("wall", "wall", spaced(*STUDY["wall"]["z"]), lambda z: [f"particles.0.position=[0.0,0.0,{z!r}]",
          f"particles.1.position=[0.2,0.1,{z - 0.6!r}]"], "first particle's z",
          "z of the first particle's centre, the second's is 0.6 less, both move to the left; the wall stands at -5")


def thin():
    part = STUDY["thin"]
    depth, count = part["optical_depth"], part["count"]
    true = record("thin", "definition", "opacity of the middle pixel", -math.expm1(-depth * count))
    pictures = dict(zip(METHODS, renders([("thin", m) for m in METHODS])))
    rows, values = [], []
    for m in METHODS:
        shown = record("thin", m, "opacity of the middle pixel", middle(pictures[m]))
        rows.append([m, f"{shown:.6f}", short(abs(shown - true))])
        if m != TRUTH:
            judge("thin", m, abs(shown - true), "error of the opacity")
            values.append((m, abs(shown - true)))
    # What others do, with the opacity of one particle.
    alpha = -math.expm1(-depth)
    dropped = 0.0 if alpha < 1 / 255 else true
    eighth = round(alpha * 255) / 255
    through = -math.expm1(count * math.log1p(-eighth))
    for name, shown in [("drops alpha below 1/255", dropped), ("alpha rounded to 8 bits", through)]:
        record("thin", name, "opacity of the middle pixel", shown)
        rows.append([f"*{name}*", f"{shown:.6f}", short(abs(shown - true))])
        values.append((name, abs(shown - true)))
    put("thin", table(["", f"opacity; true: {true:.6f}", "error"], rows))
    bars("thin", "error of the opacity", values)
    bound("thin", [pictures[TRUTH]])


def past_one():
    part = STUDY["past_one"]
    series = {m: [] for m in METHODS}
    truths = []
    for total in part["total"]:
        opacity = -math.expm1(-total / 4)
        pictures = renders([("past-one", m, f"particles.0.opacity={opacity!r}") for m in METHODS])
        truths.append(pictures[-1])
        for m, picture in zip(METHODS, pictures):
            series[m].append((total, record("past_one", m, f"opacity at optical depth {total}", middle(picture))))
    rows, worst_at = [], 0
    for m in METHODS[:-1]:
        errors = [abs(a - b) for (_, a), (_, b) in zip(series[m], series[TRUTH])]
        worst = max(range(len(errors)), key=errors.__getitem__)
        judge("past_one", m, errors[worst], "largest error of the opacity")
        rows.append([m, short(errors[worst]), part["total"][worst]])
        worst_at = part["total"][worst] if m == "sheet" else worst_at
    put("past_one", table(["", "largest error of the opacity", "at optical depth"], rows))
    chart("past-one", svg.lines("Opacity of four particles in one place", "optical depth of all together", "opacity",
                                [(m, series[m]) for m in [TRUTH, *METHODS[:-1]]]))
    true, costs = -math.expm1(-worst_at), []
    for width in part["widths"]:
        shown = middle(render("past-one", "sheet", f"particles.0.opacity={-math.expm1(-worst_at / 4)!r}",
                              f"render.method.sheet.slice_width={width!r}"))
        costs.append([width, short(record("past_one", "sheet", f"error at optical depth {worst_at}, slices of {width}",
                                          abs(shown - true)))])
    put("past_one widths", table(["slice width, radius 0.5", f"error of `sheet` at optical depth {worst_at}"], costs))
    bound("past_one", truths)


def half_precision(alpha, count):
    """Opacity after so many layers, every result rounded to half precision."""
    alpha, opacity = np.float16(alpha), np.float16(0)
    for _ in range(count):
        after = np.float16(opacity + np.float16(np.float16(1 - opacity) * alpha))
        if after == opacity:
            break
        opacity = after
    return float(opacity)


def eight_bits(alpha, count):
    """The same in eight bits, rounded to the nearest."""
    alpha, opacity = round(alpha * 255), 0
    for _ in range(count):
        after = (255 * opacity + (255 - opacity) * alpha + 127) // 255
        if after == opacity:
            break
        opacity = after
    return opacity / 255


def layers():
    part = STUDY["layers"]
    true = -math.expm1(-part["optical_depth"])
    series, rows, last = {name: [] for name in [*METHODS, "half", "8 bits"]}, [], {}
    for count in part["counts"]:
        alpha = -math.expm1(-part["optical_depth"] / count)
        settings = [f"particles.{i}.{key}={value!r}" for i in range(2) for key, value in (("box.count", count // 2), ("opacity", alpha))]
        for m, picture in zip(METHODS, renders([("layers", m, *settings) for m in METHODS])):
            last[m] = picture
            series[m].append((count, record("layers", m, f"opacity of {count} layers", middle(picture))))
        for name, how in (("half", half_precision), ("8 bits", eight_bits)):
            series[name].append((count, record("layers", name, f"opacity of {count} layers", how(alpha, count))))
    for m in [*METHODS, "half", "8 bits"]:
        shown = series[m][-1][1]
        cells = [f"{shown:.6f}", short(abs(shown - true))]
        if m in METHODS[:-1]:
            off = largest(mono(last[m]) - mono(last[TRUTH]))
            record("layers", m, "error of the colour", off)
            cells.append(short(off))
            record("layers", m, "error of the opacity", abs(shown - true))
            judge("layers", m, max(abs(shown - true), off), "larger of both errors")
        else:
            cells.append("")
        rows.append([m, *cells])
    record("layers", "definition", "opacity", true)
    put("layers", table(["", f"opacity; true: {true:.6f}", "error", "error of the colour"], rows))
    names = [(m, series[m]) for m in [TRUTH, *METHODS[:-1]]]
    names += [("half precision", series["half"]), ("8 bits", series["8 bits"])]
    chart("layers", svg.lines("Opacity of gas of optical depth 3, cut into ever more layers", "layers", "opacity", names, log_x=True))
    bound("layers", [last[TRUTH]])


def far():
    shift = STUDY["far"]["shift"]
    moved = ["camera.position=" + vector([0.5 + shift[0], 0.4 + shift[1], 5 + shift[2]]), "camera.look_at=" + vector(shift),
             *(f"particles.{i}.position={vector(shift)}" for i in range(3)),
             "mesh.0.position=" + vector([shift[0], shift[1], shift[2] - 0.5])]
    rows, values, truth = [], [], None
    for m in METHODS:
        near, away = renders([("far", m), ("far", m, *moved)])
        truth = (near, away) if m == TRUTH else truth
        change = max(largest(color(near[eye]) - color(away[eye])) for eye in near)
        values.append((m, change))
        rows.append([m, short(change)])
        if m != TRUTH:
            judge("far", m, change, "largest difference from the picture at the origin")
        else:
            record("far", m, "largest difference from the picture at the origin", change)
    put("far", table(["", "largest difference from the picture at the origin"], rows))
    bars("far", "largest difference from the picture at the origin", values)
    worst = max(float(eye["E"].max()) for eye in truth[1].values())
    record("far", TRUTH, "largest bound of its own error", worst)
    # Its verdict is the picture's, as for the others: the bound counts rounding of positions in full.
    judge("far", TRUTH, values[-1][1], "largest difference from the picture at the origin, judged")


def errors(row, words="largest error of a pixel"):
    """Whole pictures of one view against the reference."""
    scene = row.replace("_", "-")
    pictures = dict(zip(METHODS, renders([(scene, m) for m in METHODS])))
    truth, rows, values = mono(pictures[TRUTH]), [], []
    for m in METHODS[:-1]:
        difference = mono(pictures[m]) - truth
        worst = largest(difference)
        _, y, x = np.unravel_index(np.abs(difference).argmax(), difference.shape)
        rmse = record(row, m, "RMSE", float(np.sqrt((difference**2).mean())))
        record(row, m, "where, column and row", f"{x} {y}")
        judge(row, m, worst, words)
        rows.append([m, short(worst), f"{x}, {y}", short(rmse)])
        values.append((m, worst))
    bars(row, words, values)
    bound(row, [pictures[TRUTH]])
    return pictures, rows


def inside():
    _, rows = errors("inside")
    put("inside", table(["", "largest error", "at column, row", "RMSE"], rows))


def wide():
    _, rows = errors("wide")
    put("wide", table(["", "largest error", "at column, row", "RMSE"], rows))


def extremes():
    pictures, rows = errors("extremes")
    for cells in rows:
        m = cells[0]
        cells.append(short(record("extremes", m, "transmittance of the middle pixel", 1 - middle(pictures[m]))))
        alone = render("extremes", m, "particles.1.opacity=0.0")
        back = largest(mono(alone) - np.array([0.25, 0.4, 0.7], np.float32).astype(np.float64)[:, None, None])
        cells.append(short(record("extremes", m, "largest trace of a particle of opacity 0", back)))
    put("extremes", table(["", "largest error", "at column, row", "RMSE", "transmittance of the middle", "trace of opacity 0"], rows))
    footprint = math.exp(-4.5)
    edge = record("extremes", "definition", "opacity in the middle of a Gaussian billboard's edge", -math.expm1(footprint * math.log(1e-6)))
    put("edge", f"A Gaussian billboard is the whole square: in the middle of its edge the footprint is still {footprint:.3f}, of which the "
                f"optical depth\nof 0.999999 makes an opacity of {edge:.2f}; towards the corners that stands outside the ball.")
    try:
        render("extremes", "slab", "particles.1.opacity=1.0")
        sys.exit("an opacity of 1 was accepted")
    except Refused as refused:
        words = str(refused).replace(str(ROOT) + "/", "")
        record("extremes", "all", "opacity 1 is refused", words.splitlines()[0])
        put("refused", "```text\n" + words + "\n```")


def outlier():
    part = STUDY["outlier"]
    series, rows, values = {m: [] for m in METHODS}, [], []
    for distance in part["distances"]:
        place = f"particles.2.position=[{distance!r},0.0,{-distance!r}]"
        for m in METHODS:
            with_it, without = renders([("outlier", m, place), ("outlier", m, place, "particles.2.opacity=0.0")])
            change = largest(mono(with_it) - mono(without))
            series[m].append((distance, record("outlier", m, f"change by a particle {distance:g} away that no ray sees", change)))
    for m in METHODS:
        distance, worst = max(series[m], key=lambda point: point[1])
        if m == TRUTH:
            record("outlier", m, "largest change", worst)
        else:
            judge("outlier", m, worst, "largest change")
        rows.append([m, short(worst), f"{distance:g}" if worst > 0 else ""])
    put("outlier", table(["", "largest change", "by a particle so far away"], rows))
    chart("outlier", svg.lines("Change of the picture by a particle that no ray sees", "distance of the particle behind and beside",
                               "change", [(m, series[m]) for m in [TRUTH, *METHODS[:-1]]], log_x=True, log_y=1e-8))
    bound("outlier", [render("outlier", TRUTH)])


def mixed_radii():
    pictures, rows = errors("mixed_radii")
    put("mixed_radii", table(["", "largest error", "at column, row", "RMSE"], rows))
    costs = []
    for slabs in STUDY["mixed_radii"]["slabs"]:
        error = largest(mono(render("mixed-radii", "slab", f"render.method.slab.slabs={slabs}")) - mono(pictures[TRUTH]))
        costs.append([slabs, short(record("mixed_radii", "slab", f"largest error with {slabs} slabs", error))])
    put("mixed_radii slabs", table(["`slabs`", "largest error of `slab`"], costs))


def oblique():
    part = STUDY["oblique"]
    series, truths = {m: [] for m in METHODS[:-1]}, []
    for angle in part["angles_deg"]:
        way = (math.sin(math.radians(angle)), 0.0, -math.cos(math.radians(angle)))
        places = [f"particles.{i}.position=" + vector(distance * c for c in way) for i, distance in enumerate((4.0, 4.3))]
        pictures = dict(zip(METHODS, renders([("oblique", m, *places) for m in METHODS])))
        truths.append(pictures[TRUTH])
        for m in METHODS[:-1]:
            error = largest(mono(pictures[m]) - mono(pictures[TRUTH]))
            series[m].append((angle, record("oblique", m, f"largest error {angle:g} degrees off the axis", error)))
    rows = []
    for m in METHODS[:-1]:
        judge("oblique", m, max(error for _, error in series[m]), "largest error")
        rows.append([m, *(short(error) for _, error in series[m])])
    put("oblique", table(["off the axis by", *(f"{angle:g}°" for angle in part["angles_deg"])], rows))
    chart("oblique", svg.lines("Two particles, one behind the other: largest error", "degrees off the axis", "error",
                               list(series.items()), log_y=1e-4))
    bound("oblique", truths)


def inconsistency():
    part = STUDY["inconsistency"]
    scene, settings = ROOT / part["scene"], part["settings"]
    try:
        truth = render(scene, TRUTH, "render.method.reference.disparity=true", *settings, planes=False)
    except Refused:
        return missing()
    rows, values = [], []
    for m in METHODS[:-1]:
        own = render(scene, m, *settings, planes=False)
        words = [PROGRAM, "compare", own["left"], truth["left"], own["right"], truth["right"], "--json"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(done.stderr)
        report = json.loads(done.stdout)
        if "inconsistency" not in report:
            return missing()
        found = report["inconsistency"]
        numbers = found if isinstance(found, dict) else {"inconsistency": found}
        numbers = {key: float(value) for key, value in numbers.items() if isinstance(value, (int, float))}
        for key, value in numbers.items():
            record("inconsistency", m, key, value)
        worst = numbers.get("rmse", max(numbers.values()))
        judge("inconsistency", m, worst, "error of the right eye less the left eye's, carried over, RMSE")
        record("inconsistency", m, "RMSE of both pictures", float(report["rmse"]))
        rows.append([m, short(worst), short(report["rmse"])])
        values.append((m, worst))
    put("inconsistency", table(["", "inconsistency, RMSE", "RMSE of both pictures"], rows) + "\n\n![](inconsistency.svg)")
    bars("inconsistency", "inconsistency, RMSE", values)
    bound("inconsistency", [{eye: exr.read(file) for eye, file in truth.items()}])
    return None


def missing():
    for m in METHODS:
        VERDICTS["inconsistency", m] = "not measured"
    put("inconsistency", "Not measured here: this version of `stereomist compare` knows no `inconsistency`. `tests/stability.rs` computes it "
        "with the\nlibrary and holds every method below the bounds of its test `the_errors_of_both_eyes_agree_but_for_a_little`.")


ROWS = {"popping": popping, "ties": ties, "rivalry": rivalry, "walk": walk, "wall": wall, "thin": thin, "past_one": past_one,
        "layers": layers, "far": far, "inside": inside, "wide": wide, "extremes": extremes, "inconsistency": inconsistency,
        "outlier": outlier, "mixed_radii": mixed_radii, "oblique": oblique}


def main():
    asked = sys.argv[1:] or list(ROWS)
    for row in asked:
        ROWS[row]()
        print(row, {m: VERDICTS.get((row, m)) for m in METHODS}, flush=True)
    if asked != list(ROWS):
        return
    lines = [[f"[{i}. {STUDY[row]['what']}](#{i}-{anchor(STUDY[row]['what'])})", *(VERDICTS[row, m] for m in METHODS)]
             for i, row in enumerate(ROWS, 1)]
    put("verdicts", table(["", *(f"`{m}`" for m in METHODS)], lines))
    put("lines", "\n".join(f"{i}. {STUDY[row]['what']}: {STUDY[row]['line']}" for i, row in enumerate(ROWS, 1)))
    with open(HERE / "results.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["row", "method", "what", "value"])
        writer.writerows(RESULTS)


def anchor(words):
    return re.sub(r"[^a-z0-9 -]", "", words.lower()).replace(" ", "-")


main()
