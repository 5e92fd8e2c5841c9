#!/usr/bin/env python3
"""Measures how fast stereomist is, beside VTK's point-Gaussian mapper on the same particles, in one run.

    pip install vtk numpy            # optional; without it the peer's columns say "not measured"
    python3 analysis/speed/run.py    # about ten minutes; rewrites results.csv, results.json, chart.svg and README.md's tables

Options: --quick (a smoke run of under two minutes; writes to target/speed-quick and leaves README.md alone), --rounds N,
--vtk-python PYTHON (an interpreter that has vtk and numpy), --no-peer, --no-build.

Needs Python 3.8 or later on Linux and nothing beyond its standard library. Everything is measured in rounds that visit
every configuration once, ours and the peer's in turn, so that a disturbance hits both sides; a number is the median over
the rounds of the medians over frames. Particles come from a fixed seed and are written as CSV files to a temporary folder,
from which both sides read them.
"""

import argparse
import csv
import json
import math
import os
import random
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SEED = 20050117

SCENES = ["walk-1000", "walk-2000", "walk-2000-small"]

# Least ratio to the peer that is wanted: (scene, method) -> level -> ratio. For one model of opacity, the peer's.
TARGETS = {
    ("walk-1000", "viewplane"): {"avx512": 80, "avx2": 65},
    ("walk-2000", "viewplane"): {"avx512": 130, "avx2": 110},
    ("walk-2000-small", "viewplane"): {"avx512": 100, "avx2": 80},
    ("walk-2000", "perspective"): {"avx512": 60, "avx2": 40},
}

# Radii of the scaling series, N^(-1/3) from 2,000 particles of 0.4, to two digits.
SERIES = [
    (1_000, 0.50), (2_000, 0.40), (5_000, 0.29), (10_000, 0.23), (20_000, 0.19), (50_000, 0.14),
    (100_000, 0.11), (200_000, 0.086), (500_000, 0.063), (1_000_000, 0.050),
]
PEER_SERIES = {1_000, 2_000, 10_000, 100_000, 1_000_000}

# Greatest ratio to the time of 2,000 particles that is wanted.
SERIES_TARGETS = {100_000: 2.2, 1_000_000: 5.0}

MEMORY_TARGET_MB = 300
START_TARGET_MS = 60

# Arithmetic of one fragment of a Gaussian particle as (operations, instructions): floating-point operations with a fused
# multiply-add counted as two, and the vector instructions that do them. Counted in the source: `value` of the method in
# src/render/method/ and `blend` in src/render/cpu/composite.rs, without the cut by opaque surfaces. Loads, masks, integer
# steps and the tables per row and column are not counted: they are what keeps the share below one.
BLEND = {
    # T -= T (a b)
    ("linear", 1): (3, 2),
    # sum += a b
    ("exponential", 1): (2, 1),
    # a b; T alpha; T -= T alpha; three sums
    ("linear", 3): (10, 6),
    # the same, and 1 - 2^-x: 16 operations in 11 instructions
    ("exponential", 3): (26, 17),
}


def operations(method, model, colors):
    """Operations and instructions per fragment."""
    value = (0, 0)
    if method == "perspective":
        # The distance: a subtraction, an addition, two multiply-adds; then max, square root, product and a polynomial,
        # whose length is read from the source.
        source = (ROOT / "src" / "render" / "cpu" / "footprint.rs").read_text()
        terms = int(re.search(r"GAUSSIAN_BALL: \[f32; (\d+)\]", source).group(1))
        value = (9 + 2 * (terms - 1), 7 + terms - 1)
    return tuple(a + b for a, b in zip(value, BLEND[model, colors]))


STAGES = ["plan", "meshes", "prepare", "order", "transform", "bin", "raster", "finish"]

FIELDS = [
    "round", "program", "scene", "particles", "radius", "opacity", "colors", "method", "opacity_model", "level", "threads",
    "views", "width", "height", "tolerance", "repeat", "warmup", "median_ms", "min_ms", "spread_ms",
] + [f"{stage}_ms" for stage in STAGES] + ["fragments", "billboard_fragments", "wall_s", "others_share", "note"]


# ---------------------------------------------------------------------------------------------------- the machine

def cpu_info():
    """Model, family and features of the first CPU."""
    info = {}
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            key, _, value = line.partition(":")
            if not line.strip() and info:
                break
            info[key.strip()] = value.strip()
    except OSError:
        pass
    name = info.get("model name", "unknown CPU")
    if "cpu family" in info:
        name += f" (family {info['cpu family']}, model {info.get('model', '?')})"
    return name


def busy_seconds():
    """Processor time of the whole machine that somebody used, or that the host took away."""
    try:
        fields = [int(value) for value in Path("/proc/stat").read_text().splitlines()[0].split()[1:9]]
    except (OSError, ValueError, IndexError):
        return None
    user, nice, system, _idle, _wait, irq, soft, steal = fields
    return (user + nice + system + irq + soft + steal) / os.sysconf("SC_CLK_TCK")


class Noise:
    """What others took of the processors while our children ran."""

    def __init__(self):
        self.others = 0.0
        self.capacity = 0.0

    def share(self):
        return self.others / self.capacity if self.capacity else None


NOISE = Noise()


def run(command, noise=True, **options):
    """Runs a child to its end: its output, seconds, peak memory in MB, and what others took of the machine meanwhile."""
    before, start = busy_seconds(), time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen([str(part) for part in command], stdout=out, stderr=err, **options)
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status) if hasattr(os, "waitstatus_to_exitcode") else status >> 8
        out.seek(0)
        err.seek(0)
        text, complaint = out.read().decode(), err.read().decode(errors="replace")
    if child.returncode != 0:
        raise SystemExit(f"{' '.join(str(part) for part in command)}\nended with {child.returncode}:\n{complaint[-2000:]}")
    others = None
    if before is not None and wall > 0:
        capacity = wall * (os.cpu_count() or 1)
        taken = max(0.0, busy_seconds() - before - usage.ru_utime - usage.ru_stime)
        others = min(1.0, taken / capacity)
        if noise:
            NOISE.others += others * capacity
            NOISE.capacity += capacity
    return {"text": text, "wall_s": wall, "memory_mb": usage.ru_maxrss * 1024 / 1e6, "others": others}


# ---------------------------------------------------------------------------------------------------- scenes

class Shipped:
    """A shipped scene whose box of particles can be replaced by a file."""

    def __init__(self, name):
        self.text = (ROOT / "scenes" / f"{name}.toml").read_text()
        box = re.search(r"^\[particles\.box\]\n(?:(?!\[).*\n)*", self.text, re.M)
        if not box:
            raise SystemExit(f"scenes/{name}.toml has no [particles.box]")
        self.box = box.group(0)
        self.rest = self.text.replace(self.box, "")
        self.count = int(self.number("count", self.box))
        self.low, self.high = self.numbers("min", self.box), self.numbers("max", self.box)
        self.radius = self.number("radius", self.rest)
        self.opacity = self.number("opacity", self.rest)
        self.grey = self.numbers("color", self.rest[self.rest.index("[[particles]]"):])[0]
        self.size = [int(value) for value in self.numbers("size", self.rest)]
        self.fov = math.radians(self.number("fov_y_deg", self.rest))
        self.near = self.number("near", self.rest)
        self.interocular = self.number("interocular", self.rest)
        self.convergence = self.number("convergence", self.rest)

    @staticmethod
    def number(key, text):
        return float(re.search(rf"^{key} = ([-0-9.]+)", text, re.M).group(1))

    @staticmethod
    def numbers(key, text):
        return [float(value) for value in re.search(rf"^{key} = \[(.*?)\]", text, re.M).group(1).split(",")]

    def billboard_pixels(self, x, y, z, radius):
        """Pixels of both eyes whose centres a particle's billboard covers."""
        depth, (width, height) = -z, self.size
        if depth <= self.near:
            return 0
        focal = height / 2 / math.tan(self.fov / 2)
        half, total = focal * radius / depth, 0
        rows = pixels(height / 2 - focal * y / depth, half, height)
        for eye in (-self.interocular / 2, self.interocular / 2):
            shift = eye / self.convergence
            total += rows * pixels(width / 2 + focal * ((x - eye) / depth + shift), half, width)
        return total

    def write(self, folder, stem, count, radius, colors=1):
        """Writes `stem.csv` and `stem.toml`; the same count always gives the same particles."""
        chance = random.Random(SEED + count)
        sides = list(zip(self.low, self.high))
        covered = 0
        with open(folder / f"{stem}.csv", "w") as out:
            out.write("x,y,z\n" if colors == 1 else "x,y,z,r,g,b\n")
            for i in range(count):
                x, y, z = (round(chance.uniform(low, high), 6) for low, high in sides)
                covered += self.billboard_pixels(x, y, z, radius)
                row = f"{x:.6f},{y:.6f},{z:.6f}"
                if colors > 1:
                    row += ("," + ["0.8,0.3,0.2", "0.3,0.7,0.3", "0.2,0.4,0.9"][i % 3])
                out.write(row + "\n")
        text = self.rest.replace("[[particles]]\n", f'[[particles]]\nfile = "{stem}.csv"\n', 1)
        text = re.sub(r"^radius = .*$", f"radius = {radius}", text, flags=re.M)
        path = folder / f"{stem}.toml"
        path.write_text(text)
        return {
            "name": stem, "path": path, "csv": folder / f"{stem}.csv", "count": count, "radius": radius,
            "opacity": self.opacity, "grey": self.grey, "colors": colors, "billboard_fragments": covered, "size": self.size,
        }


def pixels(centre, half, size):
    first = max(0, math.ceil(centre - half - 0.5))
    last = min(size - 1, math.floor(centre + half - 0.5))
    return max(0, last - first + 1)


# ---------------------------------------------------------------------------------------------------- measuring

class Bench:
    """Everything that is measured, row by row."""

    def __init__(self, options, binary, folder):
        self.options, self.binary, self.folder = options, binary, folder
        self.rows = []
        self.round = 0
        self.repeat, self.warmup = (4, 1) if options.quick else (20, 5)

    def row(self, scene, **values):
        row = dict.fromkeys(FIELDS)
        row.update(
            round=self.round, scene=scene["name"], particles=scene["count"], radius=scene["radius"],
            opacity=scene["opacity"], colors=scene["colors"], width=scene["size"][0], height=scene["size"][1], **values,
        )
        if row["views"] == 2:
            row["billboard_fragments"] = scene["billboard_fragments"]
        self.rows.append(row)
        return row

    def ours(self, scene, method, model, level, threads, mono=False, tolerance=None):
        repeat = self.repeat
        command = [
            self.binary, "bench", scene["path"], "--json", "--method", method, "--simd", level, "--threads", threads,
            "--set", f"render.opacity_model={model}", "--repeat", repeat, "--warmup", self.warmup,
        ]
        command += ["--mono"] if mono else []
        command += [] if tolerance is None else ["--tolerance", tolerance]
        done = run(command)
        result = json.loads(done["text"])
        if result["simd"] != level or result["method"] != method:
            raise SystemExit(f"asked for {method} with {level}, got {result['method']} with {result['simd']}")
        stages = {f"{stage}_ms": time for stage, time in result["stages"].items() if f"{stage}_ms" in FIELDS}
        self.row(
            scene, program="stereomist", method=method, opacity_model=model, level=level, threads=threads,
            views=result["views"], tolerance=result["tolerance"], repeat=repeat, warmup=self.warmup,
            median_ms=result["median_ms"], min_ms=result["min_ms"], spread_ms=result["spread_ms"],
            fragments=result["fragments"], wall_s=done["wall_s"], others_share=done["others"], **stages,
        )

    def peer(self, scene, frames, warmup, compare=None):
        if not self.options.vtk_python:
            return None
        command = [
            self.options.vtk_python, HERE / "vtk_point_gaussian.py", scene["csv"], "--radius", scene["radius"],
            "--opacity", scene["opacity"], "--grey", scene["grey"], "--frames", frames, "--warmup", warmup,
        ]
        command += ["--compare", compare] if compare else []
        done = run(command)
        result = json.loads(done["text"].strip().splitlines()[-1])
        self.row(
            scene, program="vtk", method="point gaussian", opacity_model="linear", threads=os.cpu_count(), views=2,
            repeat=frames, warmup=warmup, median_ms=result["median_ms"], min_ms=result["min_ms"],
            wall_s=done["wall_s"], others_share=done["others"],
            note=f"{result['peer']}, {result['window']}, {result['drawn_by']}",
        )
        return result

    def find(self, **wanted):
        """Rows with these values, one per round. What is not said is the usual: two eyes, one colour, all threads."""
        wanted.setdefault("program", "stereomist")
        if wanted["program"] == "stereomist":
            for key, value in (("views", 2), ("colors", 1), ("threads", self.options.threads), ("tolerance", 1 / 255)):
                wanted.setdefault(key, value)
        close = lambda a, b: abs(a - b) < 1e-9 if isinstance(b, float) and isinstance(a, float) else a == b
        return [row for row in self.rows if all(close(row[key], value) for key, value in wanted.items())]

    def value(self, key="median_ms", **wanted):
        """Median over the rounds."""
        values = [row[key] for row in self.find(**wanted) if row[key] is not None]
        return statistics.median(values) if values else None


def measure(bench, scenes, levels, peaks):
    """All rounds."""
    options = bench.options
    best, threads = levels[0], options.threads
    frames, warmup = (1, 1) if options.quick else (5, 2)
    walk = scenes["walk-2000"]
    for bench.round in range(1, options.rounds + 1):
        say(f"round {bench.round} of {options.rounds}: peak")
        peaks.append(json.loads(run([options.peak, threads])["text"]))
        # Beside the peer: a level of ours, the peer, the other levels, and so on.
        for name in SCENES:
            scene = scenes[name]
            say(f"round {bench.round} of {options.rounds}: {name}")
            for number, level in enumerate(levels):
                for model in ("linear", "exponential"):
                    bench.ours(scene, "viewplane", model, level, threads)
                    if name == "walk-2000":
                        bench.ours(scene, "perspective", model, level, threads)
                if number == 0:
                    bench.peer(scene, frames, warmup)
        bench.ours(walk, "viewpoint", "linear", best, threads)

        say(f"round {bench.round} of {options.rounds}: scaling")
        for count, _ in options.series:
            scene = scenes[f"series-{count}"]
            for level in levels[:2]:
                bench.ours(scene, "viewplane", "linear", level, threads)
            bench.ours(scene, "perspective", "linear", best, threads)
            # The peer takes its time: one round, few frames.
            if bench.round == 1 and count in PEER_SERIES and not (options.quick and count > 10_000):
                bench.peer(scene, 1 if options.quick or count > 10_000 else 3, 1)

        say(f"round {bench.round} of {options.rounds}: one eye, threads, colours, no early end")
        for name in options.detailed:
            for method in ("viewplane", "perspective"):
                bench.ours(scenes[name], method, "linear", best, threads, mono=True)
                for n in {1, 2, threads} - {threads}:
                    if n <= (os.cpu_count() or 1):
                        bench.ours(scenes[name], method, "linear", best, n)
        for model in ("linear", "exponential"):
            for level in levels:
                bench.ours(scenes["colors"], "viewplane", model, level, threads)
            bench.ours(scenes["colors"], "perspective", model, best, threads)
            for method in ("viewplane", "perspective"):
                bench.ours(walk, method, model, best, threads, tolerance=0)


def render_costs(bench, scenes):
    """Start-up time of a small render and peak memory of a big one."""
    say("start-up and memory")
    small, out = scenes["small"], bench.folder / "out"
    command = [bench.binary, "render", small["path"], "-o", out, "--size", "320x240", "--quiet"]
    run(command)
    times = [run(command)["wall_s"] * 1e3 for _ in range(3 if bench.options.quick else 20)]
    result = {
        "start": {"particles": small["count"], "size": [320, 240], "runs": len(times), "median_ms": statistics.median(times),
                  "min_ms": min(times), "max_ms": max(times)},
        "memory": [],
    }
    big = scenes[f"series-{bench.options.series[-1][0]}"]
    box = bench.folder / "box.toml"
    shipped = Shipped("walk-2000")
    box.write_text(re.sub(r"^count = .*$", f"count = {big['count']}", re.sub(
        r"^radius = .*$", f"radius = {big['radius']}", shipped.text, flags=re.M), flags=re.M))
    for source, path in (("box", box), ("CSV", big["path"])):
        for method in ("viewplane", "perspective"):
            done = run([bench.binary, "render", path, "-o", out, "--quiet", "--method", method])
            result["memory"].append({"particles": big["count"], "source": source, "method": method,
                                     "peak_mb": done["memory_mb"], "wall_s": done["wall_s"]})
    return result


# ---------------------------------------------------------------------------------------------------- tables

def number(value, digits=3):
    """A number to three significant digits, as people read it."""
    if value is None:
        return "not measured"
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"


def table(head, rows, left=1):
    """A Markdown table; the first `left` columns are words."""
    lines = ["| " + " | ".join(head) + " |", "|" + "|".join(["---"] * left + ["--:"] * (len(head) - left)) + "|"]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def verdict(value, target, at_least=True):
    if target is None:
        return ""
    if value is None:
        return f"{target} (not measured)"
    met = value >= target if at_least else value <= target
    return f"{target:g} {'met' if met else '**missed**'}"


def share_of_peak(bench, peak, method, model, colors, **wanted):
    """GFLOP/s of the fragments, over the whole frame and over the raster stage, and shares of the level's peak."""
    flop, instructions = operations(method, model, colors)
    fused = wanted["level"] in ("avx2", "avx512")
    wanted = dict(method=method, opacity_model=model, colors=colors, **wanted)
    fragments, frame = bench.value("fragments", **wanted), bench.value(**wanted)
    raster = bench.value("raster_ms", **wanted)
    if not frame or not raster or not peak:
        return None
    rate = lambda count, ms: fragments * count / ms / 1e6
    return {
        "fragments": fragments, "frame_ms": frame, "operations": flop, "instructions": instructions,
        "gflops": rate(flop, frame), "share_frame": rate(flop, frame) / peak, "share_raster": rate(flop, raster) / peak,
        # A fused multiply-add is two operations in one slot, so the peak in slots is half of it; without one, an operation
        # is an instruction.
        "slots_raster": rate(instructions, raster) / (peak / 2) if fused else rate(flop, raster) / peak, "peak": peak,
    }


def ratios(bench, scene, method, model, level):
    """Ours, the peer's, their ratio, and the least and greatest ratio of a round."""
    ours = bench.find(scene=scene, method=method, opacity_model=model, level=level)
    peer = bench.find(program="vtk", scene=scene)
    result = {"scene": scene, "method": method, "opacity_model": model, "level": level,
              "ours_ms": statistics.median(row["median_ms"] for row in ours),
              "ours_min_ms": min(row["min_ms"] for row in ours), "peer_ms": None, "ratio": None, "ratio_of_fastest": None, "rounds": []}
    if peer:
        result["peer_min_ms"] = min(row["min_ms"] for row in peer)
        result["ratio_of_fastest"] = result["peer_min_ms"] / result["ours_min_ms"]
        result["peer_ms"] = statistics.median(row["median_ms"] for row in peer)
        result["ratio"] = result["peer_ms"] / result["ours_ms"]
        by_round = {row["round"]: row["median_ms"] for row in peer}
        result["rounds"] = [by_round[row["round"]] / row["median_ms"] for row in ours if row["round"] in by_round]
    return result


def summarise(bench, levels, peaks, costs, machine):
    """The tables, by the name of their place in README.md, and the same as data."""
    options, best = bench.options, levels[0]
    data, tables = {"machine": machine}, {}

    tables["machine"] = table(["", ""], [
        ["processor", machine["cpu"]], ["cores seen", machine["cores"]],
        ["vector instructions", ", ".join(levels) + " (the first is what runs by default)"],
        ["threads", options.threads], ["system", machine["system"]], ["stereomist", machine["version"]],
        ["peer", machine["peer"]], ["date", machine["date"]],
    ], left=2)

    # Noise: what others took, and how far rounds are apart.
    apart = []
    groups = {}
    for row in bench.rows:
        if row["program"] == "stereomist":
            groups.setdefault(tuple(row[key] for key in FIELDS[2:15]), []).append(row["median_ms"])
    for values in groups.values():
        apart.append((max(values) - min(values)) / statistics.median(values))
    share = NOISE.share()
    data["noise"] = {"others_share": share, "rounds": options.rounds,
                     "rounds_apart_median": statistics.median(apart), "rounds_apart_max": max(apart)}
    tables["noise"] = (
        f"{options.rounds} round{'s' * (options.rounds > 1)}. Other programs, and the host of a virtual machine, took "
        f"{'an unknown share' if share is None else f'{100 * share:.0f} %'} of the processors while this ran."
    )
    if options.rounds > 1:
        tables["noise"] += (
            f" The slowest and the fastest round of a measurement differ by up to {100 * statistics.median(apart):.0f} % for "
            f"half of the {len(apart)} measurements, and by {100 * max(apart):.0f} % for the worst."
        )
    if share is not None and share > 0.05:
        tables["noise"] += (" **That is a disturbed machine**: times are too long, ratios are uncertain, and the arithmetic "
                            "peak on all threads is too low.")

    # Beside the peer.
    data["peer"], rows = [], []
    for scene in SCENES:
        for method in ("viewplane", "perspective"):
            for level in levels:
                for model in ("linear", "exponential"):
                    if not bench.find(scene=scene, method=method, opacity_model=model, level=level):
                        continue
                    one = ratios(bench, scene, method, model, level)
                    target = TARGETS.get((scene, method), {}).get(level) if model == "linear" else None
                    one.update(target=target, met=None if target is None or one["ratio"] is None else one["ratio"] >= target)
                    data["peer"].append(one)
                    span = f"{number(min(one['rounds']))} to {number(max(one['rounds']))}" if one["rounds"] else ""
                    rows.append([scene, method, level, model, number(one["ours_ms"]), number(one["ours_min_ms"]),
                                 number(one["peer_ms"]), number(one["ratio"]), span, number(one["ratio_of_fastest"]),
                                 verdict(one["ratio"], target)])
    tables["peer"] = table(["scene", "method", "level", "opacity", "ms", "fastest ms", "VTK ms", "times faster",
                            "rounds from, to", "fastest to fastest", "at least"], rows, left=4)

    # Scaling.
    data["scaling"], rows = [], []
    base = {level: bench.value(scene="series-2000", method="viewplane", level=level) for level in levels[:2]}
    for count, radius in options.series:
        scene = f"series-{count}"
        one = {"particles": count, "radius": radius,
               "billboard_fragments": bench.value("billboard_fragments", scene=scene, method="viewplane", level=best),
               "fragments": bench.value("fragments", scene=scene, method="viewplane", level=best),
               "viewplane": {level: bench.value(scene=scene, method="viewplane", level=level) for level in levels[:2]},
               "perspective": bench.value(scene=scene, method="perspective", level=best),
               "peer": bench.value(program="vtk", scene=scene), "target": SERIES_TARGETS.get(count)}
        one["to_2000"] = {level: one["viewplane"][level] / base[level] for level in levels[:2]}
        data["scaling"].append(one)
        rows.append([f"{count:,}", radius, number(one["billboard_fragments"] / 1e6), number(one["fragments"] / 1e6)]
                    + [cell for level in levels[:2] for cell in
                       (number(one["viewplane"][level]), number(one["to_2000"][level]))]
                    + [verdict(one["to_2000"][best], one["target"], at_least=False), number(one["perspective"]),
                       number(one["peer"]) if one["peer"] or count in PEER_SERIES else ""])
    tables["scaling"] = table(
        ["particles", "radius", "billboards, M", "computed, M"]
        + [cell for level in levels[:2] for cell in (f"viewplane {level}, ms", "to 2,000")]
        + ["at most", f"perspective {best}, ms", "VTK ms"], rows, left=0)

    # Stages, one eye and two.
    data["stages"], rows = [], []
    kinds = [(name, method, views) for name in options.detailed for method in ("viewplane", "perspective") for views in (1, 2)]
    kinds.insert(4, ("walk-2000", "viewpoint", 2))
    for scene, method, views in kinds:
        wanted = dict(scene=scene, method=method, opacity_model="linear", level=best, views=views)
        total = bench.value(**wanted)
        if total is None:
            continue
        one = {**wanted, "particles": bench.find(**wanted)[0]["particles"], "total_ms": total,
               "stages_ms": {stage: bench.value(f"{stage}_ms", **wanted) for stage in STAGES},
               "fragments": bench.value("fragments", **wanted)}
        data["stages"].append(one)
        stages = [one["stages_ms"][stage] for stage in STAGES]
        rows.append([f"{one['particles']:,}", method, views]
                    + ["" if value is None else f"{value:.3f}" for value in stages] + [number(total), number(one["fragments"] / 1e6)])
    tables["stages"] = table(["particles", "method", "eyes"] + STAGES + ["whole frame, ms", "fragments, M"], rows, left=2)

    # Threads.
    data["threads"], rows = [], []
    counts = sorted({row["threads"] for row in bench.rows if row["program"] == "stereomist"})
    for name in options.detailed:
        for method in ("viewplane", "perspective"):
            times = [bench.value(scene=name, method=method, opacity_model="linear", level=best, threads=n) for n in counts]
            data["threads"].append({"scene": name, "method": method, "threads": counts, "ms": times})
            particles = bench.find(scene=name, method=method)[0]["particles"]
            gain = times[0] / times[-1] if times[0] and times[-1] else None
            rows.append([f"{particles:,}", method] + [number(value) for value in times] + [number(gain)])
    tables["threads"] = table(["particles", "method"] + [f"{n} thread{'s' * (n > 1)}, ms" for n in counts] + ["gain"], rows,
                              left=2)

    # Colours.
    data["colors"], rows = [], []
    for method, of in (("viewplane", levels), ("perspective", [best])):
        for level in of:
            for model in ("linear", "exponential"):
                wanted = dict(method=method, opacity_model=model, level=level)
                one = bench.value(scene="walk-2000", **wanted)
                three = bench.value(scene="colors", colors=3, **wanted)
                data["colors"].append({**wanted, "one_ms": one, "three_ms": three})
                rows.append([method, level, model, number(one), number(three), number(three / one)])
    tables["colors"] = table(["method", "level", "opacity", "one colour, ms", "three colours, ms", "ratio"], rows, left=3)

    # The arithmetic peak.
    data["peak"], rows = {}, []
    for level in levels:
        found = [entry for peak in peaks for entry in peak["levels"] if entry["level"] == level]
        peak = {"all_threads": max(entry["gflops"] for entry in found), "lanes": found[0]["lanes"],
                "one_thread": max(entry["gflops_one_thread"] for entry in found),
                "median": statistics.median(entry["gflops_median"] for entry in found), "uses": []}
        data["peak"][level] = peak
        rows.append([level, peak["lanes"], number(peak["one_thread"]), number(peak["all_threads"]), number(peak["median"])])
    tables["peak"] = table(["level", "lanes", "one thread", f"{options.threads} threads", "its middle run"], rows)
    rows = []
    cases = [("walk-2000", method, model, 1, level, tolerance) for tolerance in (1 / 255, 0.0)
             for method in ("viewplane", "perspective") for model in ("linear", "exponential") for level in levels]
    cases += [("colors", "viewplane", model, 3, level, 1 / 255) for model in ("linear", "exponential") for level in levels]
    for scene, method, model, colors, level, tolerance in cases:
        one = share_of_peak(bench, data["peak"][level]["all_threads"], method, model, colors, scene=scene, level=level,
                            tolerance=tolerance)
        if one is None:
            continue
        data["peak"][level]["uses"].append({"scene": scene, "method": method, "opacity_model": model, "colors": colors,
                                            "tolerance": tolerance, **one})
        rows.append([method, model, colors, "yes" if tolerance else "no", level, number(one["fragments"] / 1e6),
                     number(one["fragments"] / one["frame_ms"] / 1e6), one["operations"], number(one["gflops"]),
                     f"{100 * one['share_frame']:.0f} %", f"{100 * one['share_raster']:.0f} %",
                     f"{100 * one['slots_raster']:.0f} %"])
    tables["share"] = table(
        ["method", "opacity", "colours", "ends early", "level", "fragments, M", "per ns", "FLOP each", "GFLOP/s",
         "of the peak, frame", "of the peak, raster", "of the slots, raster"], rows, left=2)

    # Start-up and memory.
    data["costs"] = costs
    start = costs["start"]
    rows = [[f"start to exit, {start['particles']} particles, {start['size'][0]}x{start['size'][1]}, four pictures, "
             f"median of {start['runs']}", f"{number(start['median_ms'])} ms ({number(start['min_ms'])} to "
             f"{number(start['max_ms'])})", verdict(start["median_ms"], START_TARGET_MS, at_least=False)]]
    for one in costs["memory"]:
        full = one["particles"] == 1_000_000
        rows.append([f"peak memory of `render`, {one['particles']:,} particles from a {one['source']}, {one['method']}",
                     f"{number(one['peak_mb'])} MB ({number(one['wall_s'])} s)",
                     verdict(one["peak_mb"], MEMORY_TARGET_MB, at_least=False) if full else ""])
    tables["costs"] = table(["", "measured", "at most"], rows)

    if machine.get("difference"):
        apart = machine["difference"]
        tables["agreement"] = (f"The left pictures of walk-2000 differ by {number(apart['mean_255'])}/255 on average and by at "
                               f"most {number(apart['max_255'])}/255.")
    else:
        tables["agreement"] = "The pictures were not compared: the peer was not measured."
    return tables, data


# ---------------------------------------------------------------------------------------------------- chart

def chart(data, levels):
    """Time against particle count, both axes logarithmic."""
    width, height = 1200, 760
    left, right, top, bottom = 110, 250, 84, 92
    best = levels[0]
    pretty = {"avx512": "AVX-512", "avx2": "AVX2", "sse2": "SSE2", "portable": "portable"}
    series = []
    line = [(one["particles"], one["peer"]) for one in data["scaling"] if one["peer"]]
    if line:
        series.append(("VTK point Gaussian", "#b5462a", "square", line))
    line = [(one["particles"], one["perspective"]) for one in data["scaling"]]
    series.append((f"perspective, {pretty[best]}", "#7a4fa3", "circle", line))
    for level, color in zip(levels[:2][::-1], ["#3f8fc4", "#14507e"][2 - len(levels[:2]):]):
        line = [(one["particles"], one["viewplane"][level]) for one in data["scaling"]]
        series.append((f"viewplane, {pretty[level]}", color, "circle", line))
    counts = [n for _, _, _, line in series for n, _ in line]
    times = [ms for _, _, _, line in series for _, ms in line]
    x0, x1 = math.log10(min(counts)), math.log10(max(counts))
    y0, y1 = math.floor(math.log10(min(times))), math.ceil(math.log10(max(times)))
    at_x = lambda n: left + (math.log10(n) - x0) / max(x1 - x0, 1e-9) * (width - left - right)
    at_y = lambda ms: height - bottom - (math.log10(ms) - y0) / (y1 - y0) * (height - top - bottom)

    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="DejaVu Sans, Verdana, Helvetica, Arial, sans-serif" font-size="17" fill="#222">',
        "<title>Time per stereo frame against the number of particles</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="{left}" y="36" font-size="23">Time per stereo frame, 2 x 1024 x 768 pixels</text>',
        f'<text x="{left}" y="62" fill="#555">{escape(data["machine"]["cpu"])}, {data["machine"]["threads"]} threads; '
        'radius shrinks as N<tspan dy="-6" font-size="12">-1/3</tspan></text>',
    ]
    def grid(position, vertical, strong):
        color = "#cfcfcf" if strong else "#ececec"
        if vertical:
            return f'<path d="M{position:.1f} {top}V{height - bottom}" stroke="{color}"/>'
        return f'<path d="M{left} {position:.1f}H{width - right}" stroke="{color}"/>'
    for power in range(math.floor(x0), math.ceil(x1) + 1):
        for k in range(1, 10):
            n = k * 10 ** power
            if min(counts) <= n <= max(counts):
                svg.append(grid(at_x(n), True, k == 1))
        if x0 - 1e-9 <= power <= x1 + 1e-9:
            svg.append(f'<text x="{at_x(10 ** power):.1f}" y="{height - bottom + 28}" text-anchor="middle">{10 ** power:,}</text>')
    for power in range(y0, y1 + 1):
        for k in range(1, 10):
            if power < y1 or k == 1:
                svg.append(grid(at_y(k * 10.0 ** power), False, k == 1))
        svg.append(f'<text x="{left - 12}" y="{at_y(10.0 ** power) + 6:.1f}" text-anchor="end">{10.0 ** power:,.{max(0, -power)}f}</text>')
    svg.append(f'<path d="M{left} {top}V{height - bottom}H{width - right}" fill="none" stroke="#444" stroke-width="1.5"/>')
    svg.append(f'<text x="{(left + width - right) / 2:.0f}" y="{height - 28}" text-anchor="middle">particles N</text>')
    middle = (top + height - bottom) / 2
    svg.append(f'<text x="34" y="{middle:.0f}" text-anchor="middle" transform="rotate(-90 34 {middle:.0f})">'
               'milliseconds per stereo frame</text>')
    # Labels at the ends of the lines, pushed apart where they would touch.
    labels = sorted(((at_y(line[-1][1]), i) for i, (_, _, _, line) in enumerate(series)))
    heights, last = {}, -1e9
    for y, i in labels:
        last = max(y, last + 22)
        heights[i] = last
    for i, (name, color, shape, line) in enumerate(series):
        path = " ".join(f"{at_x(n):.1f},{at_y(ms):.1f}" for n, ms in line)
        svg.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2.5"/>')
        for n, ms in line:
            if shape == "square":
                svg.append(f'<rect x="{at_x(n) - 5:.1f}" y="{at_y(ms) - 5:.1f}" width="10" height="10" fill="{color}"/>')
            else:
                svg.append(f'<circle cx="{at_x(n):.1f}" cy="{at_y(ms):.1f}" r="4.5" fill="{color}"/>')
        end = at_x(line[-1][0])
        svg.append(f'<text x="{end + 14:.1f}" y="{heights[i] + 6:.1f}" fill="{color}">{name}</text>')
    svg.append("</svg>")
    return "\n".join(svg) + "\n"


def escape(text):
    return text.replace("&", "&amp;").replace("<", "&lt;")


# ---------------------------------------------------------------------------------------------------- the run

def say(text):
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def fill(text, tables):
    """Replaces what stands between `<!-- name -->` and `<!-- /name -->`."""
    for name, body in tables.items():
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.S)
        text, found = pattern.subn(lambda match: f"{match.group(1)}{body}\n{match.group(2)}", text)
        if found != 1:
            say(f"README.md has {found} places for the table '{name}'")
    return text


def has_vtk(python):
    done = subprocess.run([python, "-c", "import numpy, vtk"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return done.returncode == 0


def build(options):
    """Builds the program and the peak measurement; returns their paths."""
    if not options.no_build:
        subprocess.run(["cargo", "build", "--release", "--bin", "stereomist", "--example", "peak"], cwd=ROOT, check=True)
    found = subprocess.run(["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=ROOT, check=True,
                           stdout=subprocess.PIPE)
    target = Path(json.loads(found.stdout)["target_directory"])
    return target, target / "release" / "stereomist", target / "release" / "examples" / "peak"


def main():
    parser = argparse.ArgumentParser(description="Measures stereomist's speed beside VTK's.")
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes to target/speed-quick")
    parser.add_argument("--rounds", type=int, help="how often everything is measured [default: 3; with --quick 1]")
    parser.add_argument("--vtk-python", metavar="PYTHON", default=sys.executable, help="an interpreter with vtk and numpy")
    parser.add_argument("--no-peer", action="store_true", help="do not measure VTK")
    parser.add_argument("--no-build", action="store_true", help="use what is built")
    options = parser.parse_args()
    options.rounds = options.rounds or (1 if options.quick else 3)
    options.threads = os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        options.threads = len(os.sched_getaffinity(0))
    options.series = [one for one in SERIES if one[0] in (2_000, 10_000, 100_000)] if options.quick else SERIES
    target, binary, options.peak = build(options)
    if options.no_peer or not has_vtk(options.vtk_python):
        say("the peer is not measured" + ("" if options.no_peer else ": no vtk and numpy (pip install vtk numpy)"))
        options.vtk_python = None
    devices = json.loads(run([binary, "devices", "--json"], noise=False)["text"])
    levels = sorted(devices["cpu"]["simd"], key=["avx512", "avx2", "sse2", "portable"].index)
    folder = Path(tempfile.mkdtemp(prefix="stereomist-speed-"))
    try:
        measured(options, target, binary, levels, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def measured(options, target, binary, levels, folder):
    say("particles")
    scenes = {}
    for name in SCENES:
        shipped = Shipped(name)
        scenes[name] = shipped.write(folder, name, shipped.count, shipped.radius)
    walk = Shipped("walk-2000")
    for count, radius in options.series:
        scenes[f"series-{count}"] = walk.write(folder, f"series-{count}", count, radius)
    scenes["colors"] = walk.write(folder, "colors", walk.count, walk.radius, colors=3)
    scenes["small"] = walk.write(folder, "small", 100, walk.radius)
    # Where one eye, threads and stages are looked at.
    options.detailed = ["walk-2000"] + [f"series-{count}" for count in (100_000, 1_000_000) if f"series-{count}" in scenes]

    bench = Bench(options, binary, folder)
    machine = {
        "cpu": cpu_info(), "cores": os.cpu_count(), "threads": options.threads, "levels": levels,
        "system": " ".join(os.uname()[i] for i in (0, 4)),
        "version": run([binary, "--version"], noise=False)["text"].strip(),
        "date": time.strftime("%Y-%m-%d"), "peer": "not measured",
    }
    # Both sides draw the same picture; a frame that does not count.
    if options.vtk_python:
        say("the same picture on both sides")
        scene = scenes["walk-2000"]
        run([binary, "render", scene["path"], "-o", folder / "out", "--quiet", "--method", "viewplane", "--format", "left",
             "--image", "png16", "--tolerance", "0"], noise=False)
        result = bench.peer(scene, 1, 0, compare=folder / "out" / "walk-2000.left.png")
        machine["difference"] = result["difference"]
        machine["peer"] = f"{result['peer']}, {result['window']}, {result['drawn_by']}"
        if result["difference"]["mean_255"] > 2:
            raise SystemExit(f"the peer draws another picture: {result['difference']}")
        bench.rows.clear()
    peaks = []
    measure(bench, scenes, levels, peaks)
    costs = render_costs(bench, scenes)
    tables, data = summarise(bench, levels, peaks, costs, machine)

    output = HERE
    if options.quick:
        output = target / "speed-quick"
        output.mkdir(parents=True, exist_ok=True)
    with open(output / "results.csv", "w", newline="") as out:
        writer = csv.DictWriter(out, FIELDS, lineterminator="\n")
        writer.writeheader()
        for row in bench.rows:
            writer.writerow({key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()})
    (output / "results.json").write_text(json.dumps(rounded(data), indent=1) + "\n")
    (output / "chart.svg").write_text(chart(data, levels))
    readme = (HERE / "README.md").read_text()
    (output / "README.md").write_text(fill(readme, tables))
    for name in ("noise", "agreement", "peer", "scaling", "share", "costs"):
        print(f"\n{tables[name]}")
    print(f"\nwritten: {output}")


def rounded(value):
    """Six digits are enough for everything measured."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {str(key): rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return value


if __name__ == "__main__":
    main()
