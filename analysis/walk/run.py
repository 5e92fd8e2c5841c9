"""`auto` on the walk through fog: against VTK in one run, with three colours, what the second eye costs, how cost grows.

    pip install vtk numpy            # optional; without it the peer's column says "not measured"
    python3 analysis/walk/run.py [--rounds 3] [--binary target/release/stereomist]

Every number is the median over rounds that visit everything once, ours and the peer's in turn. Writes results.json and the
tables of README.md.
"""

import argparse
import json
import pathlib
import random
import re
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

WALKS = ["walk-1000", "walk-2000", "walk-2000-small"]
COLORS = ["[0.9, 0.2, 0.1]", "[0.1, 0.8, 0.2]", "[0.2, 0.3, 0.9]"]
COUNTS = [1_000, 10_000, 100_000, 1_000_000, 10_000_000]


def ask(*command):
    """The JSON that a command prints."""
    return json.loads(subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True).stdout)


def scenes(folder):
    """Scene files of the three walks: with opacity 0.03, and with three colours and two opacities."""
    paths = {}
    for name in WALKS:
        text = (ROOT / f"scenes/{name}.toml").read_text()
        thin = re.sub(r"^opacity = .*$", "opacity = 0.03", text, flags=re.M)
        paths[name] = folder / f"{name}.toml"
        paths[name].write_text(thin)
        head, particles = text.split("[[particles]]", 1)
        particles, tail = re.split(r"(?=\n\[render)", particles, maxsplit=1)
        count = int(re.search(r"^count = (\d+)", particles, re.M).group(1))
        for opacity in ("0.1", "0.4"):
            sets = ""
            for i, color in enumerate(COLORS):
                own = re.sub(r"^opacity = .*$", f"opacity = {opacity}", particles, flags=re.M)
                own = re.sub(r"^color = .*$", f"color = {color}", own, flags=re.M)
                own = re.sub(r"^count = .*$", f"count = {count // 3 + (i < count % 3)}", own, flags=re.M)
                sets += "[[particles]]" + re.sub(r"^seed = .*$", f"seed = {5 + i}", own, flags=re.M) + "\n"
            paths[name, opacity] = folder / f"{name}-{opacity}.toml"
            paths[name, opacity].write_text(head + sets + tail)
    return paths


def median(rows, key):
    values = [row[key] for row in rows if key in row]
    return statistics.median(values) if values else None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/stereomist")
    options = parser.parse_args()
    binary = str(options.binary.resolve())
    has_vtk = subprocess.run([sys.executable, "-c", "import vtk"], capture_output=True).returncode == 0
    results = {"walk": {}, "colors": {}, "eyes": {}, "growth": {}, "threads": {}}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        paths = scenes(folder)
        bench = lambda path, *more: ask(binary, "bench", path, "--repeat", 40, "--warmup", 5, "--json", *more)
        for turn in range(options.rounds):
            for walk in WALKS:
                path = paths[walk]
                row = results["walk"].setdefault(walk, [])
                row.append({"auto": bench(path, "--method", "auto")["median_ms"]})
                row[-1]["auto_8"] = bench(path, "--method", "auto", "--pixels", "srgb8")["median_ms"]
                row[-1]["viewplane"] = bench(path, "--method", "viewplane")["median_ms"]
                if has_vtk:
                    radius = float(re.search(r"^radius = (.*)$", path.read_text(), re.M).group(1))
                    peer = HERE.parent / "speed/vtk_point_gaussian.py"
                    row[-1]["vtk"] = ask(
                        sys.executable, peer, write_points(path, folder), "--radius", radius, "--opacity", 0.03, "--frames", 5
                    )["median_ms"]
                for opacity in ("0.1", "0.4"):
                    path = paths[walk, opacity]
                    row = results["colors"].setdefault(f"{walk}, {opacity}", [])
                    row.append({"auto": bench(path, "--method", "auto")["median_ms"]})
                    row[-1]["auto_8"] = bench(path, "--method", "auto", "--pixels", "srgb8")["median_ms"]
                    for model in ("linear", "exponential"):
                        more = ["--method", "viewplane", "--set", f"render.opacity_model={model}"]
                        row[-1][model] = ask(binary, "bench", path, "--repeat", 10, "--warmup", 2, "--json", *more)["median_ms"]
                    if turn == 0:
                        for method in ("auto", "viewplane"):
                            more = ["--method", method, "--set", "render.opacity_model=exponential", "--tolerance", "1/255"]
                            more += ["--format", "left", "--image", "exr", "--verify", 2000, "--json", "-o", folder]
                            done = subprocess.run([binary, "render", str(path), *map(str, more)], capture_output=True, text=True)
                            row[-1][f"error_{method}"] = json.loads(done.stdout)["verification"]["largest"]
        walk = ROOT / "scenes/walk-2000.toml"
        model = ["--set", "render.opacity_model=exponential"]
        for turn in range(options.rounds):
            for method in ("viewplane", "perspective", "viewpoint", "auto"):
                for count, repeat in ((2000, 60), (1_000_000, 20)):
                    for pixels, label in (("linear", "films"), ("srgb8", "8 bits")):
                        more = ["--method", method, *model, "--sweep-particles", count, "--repeat", repeat, "--warmup", 3]
                        rows = results["eyes"].setdefault(f"{method}, {count:,}, {label}", [])
                        rows += ask(binary, "bench", walk, *more, "--pixels", pixels, "--json")["rows"]
            more = ["--method", "auto", "--sweep-particles", "2000", "--repeat", 100, "--json"]
            rows = results["eyes"].setdefault("auto with opacity 0.03, 2,000, films", [])
            rows += ask(binary, "bench", paths["walk-2000"], *more)["rows"]
        for method in ("viewplane", "perspective", "auto"):
            more = ["--method", method, *model, "--sweep-particles", ",".join(map(str, COUNTS)), "--repeat", 5, "--warmup", 1]
            results["growth"][method] = ask(binary, "bench", walk, *more, "--json")["rows"]
            more = ["--method", method, *model, "--sweep-threads", "1,2", "--repeat", 15, "--warmup", 3, "--json"]
            turns = [ask(binary, "bench", walk, *more)["rows"] for _ in range(options.rounds)]
            results["threads"][method] = [row for rows in turns for row in rows]
    (HERE / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    write(results)


def write_points(path, folder):
    """The particles of a scene's box, by its own numbers or any: a peer's time depends on how many and how large they are."""
    text = path.read_text()
    numbers = lambda key: [float(word) for word in re.search(rf"^{key} = \[(.*)\]", text, re.M).group(1).split(",")]
    low, high = numbers("min"), numbers("max")
    count = int(re.search(r"^count = (\d+)", text, re.M).group(1))
    dice = random.Random(count)
    out = folder / "points.csv"
    rows = (",".join(f"{dice.uniform(a, b):.6f}" for a, b in zip(low, high)) for _ in range(count))
    out.write_text("x,y,z\n" + "\n".join(rows) + "\n")
    return out


def write(results):
    """The tables."""
    page = HERE / "README.md"
    lines = []
    for walk, rows in results["walk"].items():
        auto, codes, plane, vtk = (median(rows, key) for key in ("auto", "auto_8", "viewplane", "vtk"))
        ratios = [f"{vtk / time:.0f}" if vtk else "not measured" for time in (codes, auto)]
        lines.append([walk, *(short(x, 3) for x in (codes, auto, plane)), short(vtk, 4) if vtk else "not measured", *ratios])
    header = ["scene", "auto, 8 bits, ms", "auto, films, ms", "viewplane, films, ms", "VTK, 8 bits, ms"]
    put(page, "walk", table([*header, "VTK over auto, 8 bits", "over auto, films"], lines))
    lines = []
    for name, rows in results["colors"].items():
        auto, codes, linear, exponential = (median(rows, key) for key in ("auto", "auto_8", "linear", "exponential"))
        own, other = rows[0]["error_auto"], rows[0]["error_viewplane"]
        numbers = [codes, auto, exponential, linear, exponential / codes, exponential / auto, linear / auto, own, other, other / own]
        lines.append([name, *(short(x, 3) for x in numbers)])
    header = ["scene, opacity", "auto, 8 bits, ms", "auto, films, ms", "viewplane, ms", "with `linear`, ms"]
    header += ["viewplane over auto, 8 bits", "over films", "`linear` over films"]
    put(page, "colors", table([*header, "auto's error", "viewplane's", "ratio"], lines))
    lines = []
    for name, rows in results["eyes"].items():
        one, two = ([row[views] for row in rows] for views in ("mono", "stereo"))
        stage = lambda frames, name: statistics.median(frame["stages"].get(name, 0) for frame in frames)
        times = [median(frames, "median_ms") for frames in (one, two)]
        stages = [
            f"{name} {short(stage(two, name) - stage(one, name), 2)}/{short(stage(one, name), 2)}"
            for name in two[0]["stages"]
            if stage(two, name) > 0.02 * times[1]
        ]
        # Both were measured in turns: a quotient for each.
        second = statistics.median(b["median_ms"] / a["median_ms"] - 1 for a, b in zip(one, two))
        lines.append([name, *(short(x, 3) for x in (*times, second)), ", ".join(stages)])
    header = ["method, particles", "one eye, ms", "two, ms", "second over first", "stages: second/first, ms"]
    put(page, "eyes", table(header, lines, ["--", "--:", "--:", "--:", "--"]))
    lines = []
    for i, count in enumerate(COUNTS):
        lines.append([f"{count:,}", *(short(rows[i]["stereo"]["median_ms"], 3) for rows in results["growth"].values())])
    put(page, "growth", table(["particles", *(f"{method}, ms" for method in results["growth"])], lines))
    lines = []
    for method, rows in results["threads"].items():
        one, two = (median([row["stereo"] for row in rows if row["threads"] == n], "median_ms") for n in (1, 2))
        lines.append([method, short(one, 3), short(two, 3), short(one / two, 3)])
    put(page, "threads", table(["method", "1 thread, ms", "2 threads, ms", "ratio"], lines))


if __name__ == "__main__":
    main()
