"""Is `auto` as fast as the best single method and setting? And how near is the error that it predicts?

usage: python3 analysis/auto/speed.py [--every 5] [--binary target/release/stereomist]

Every so many of the random scenes of run.py, at 640 x 480: `stereomist chart` measures times and errors, and the fastest
point beside `auto` that keeps 1/255 at every pixel of the sample is what `auto` is held against. Then `auto`'s predicted
error against the measured one, at three tolerances, and its predicted time. Writes speed.csv, predicted.svg and the second table of README.md.
"""

import argparse
import csv
import json
import math
import pathlib
import shutil
import statistics
import subprocess

from run import HERE, TOLERANCES, put, scene, short, table

SIZE = "640x480"
COLUMNS = ["scene", "kernels", "particles", "colors", "inside", "mesh", "auto_ms", "best", "best_ms", "ratio"]
# Of the tolerances, in the chart.
COLORS = dict(zip(TOLERANCES, ("#06c", "#c60", "#393")))
COLUMNS += [f"{what}_{name}" for name in TOLERANCES for what in ("predicted", "measured")]
COLUMNS += ["predicted_ms", "gas_ms"]
# Stages that the predicted time is not about.
ASIDE = ("plan", "meshes", "finish", "encode")


def measure(binary, number):
    """The row of one scene."""
    path, facts = scene(number, HERE / "work" / f"{number:03}")
    folder = path.parent / "chart"
    shutil.rmtree(folder, ignore_errors=True)
    command = [binary, "chart", path, "-o", folder, "--size", SIZE, "--budget", "3", "--sample", "2000"]
    methods = "viewplane,viewpoint,perspective,slab,half,quarter,auto"
    subprocess.run([*command, "--methods", methods], check=True, capture_output=True)
    with open(folder / "scene.csv", newline="") as file:
        points = list(csv.DictReader(file))
    own = {point["value"]: point for point in points if point["method"] == "auto"}
    errors = {id(point): max(float(point["max"]), float(point["transmittance_max"])) for point in points}
    others = [point for point in points if point["method"] != "auto" and errors[id(point)] <= TOLERANCES["1/255"]]
    best = min(others, key=lambda point: float(point["median_ms"]))
    time, least = float(own["1/255"]["median_ms"]), float(best["median_ms"])
    row = [number, *facts, time, " ".join([best["method"], best["parameter"], best["value"]]), least, time / least]
    for name, tolerance in TOLERANCES.items():
        command = [binary, "render", path, "--size", SIZE, "--tolerance", repr(tolerance), "-o", folder, "--json"]
        command += ["--method", "auto", "--format", "left", "--image", "exr"]
        answer = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        row += [answer["settings"]["predicted_error"], errors[id(own[name])]]
    command = [binary, "bench", path, "--size", SIZE, "--tolerance", "1/255", "--method", "auto", "--repeat", "9", "--warmup", "2", "--json"]
    answer = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    gas = sum(time for stage, time in answer["stages"].items() if stage not in ASIDE)
    return [*row, answer["predicted_ms"], gas]


def chart(pairs):
    """Measured error over predicted error, both over the tolerance, as SVG."""
    low, high, side, edge = -6.0, 0.5, 360, 60

    def place(share):
        return (min(max(math.log10(max(share, 1e-9)), low), high) - low) / (high - low) * side

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {side + 2 * edge} {side + 2 * edge}" font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<g transform="translate({edge} {edge})">',
        f'<rect width="{side}" height="{side}" fill="none" stroke="black"/>',
        f'<line x1="0" y1="{side}" x2="{side}" y2="0" stroke="gray"/>',
    ]
    for power in range(int(low), 1):
        at = place(10.0**power)
        text = "1" if power == 0 else f"1e{power}"
        lines.append(f'<line x1="{at:.1f}" y1="0" x2="{at:.1f}" y2="{side}" stroke="#ddd"/>')
        lines.append(f'<line x1="0" y1="{side - at:.1f}" x2="{side}" y2="{side - at:.1f}" stroke="#ddd"/>')
        lines.append(f'<text x="{at:.1f}" y="{side + 16}" text-anchor="middle">{text}</text>')
        lines.append(f'<text x="-6" y="{side - at + 4:.1f}" text-anchor="end">{text}</text>')
    for color, shares in zip(COLORS.values(), pairs):
        for predicted, measured in shares:
            lines.append(f'<circle cx="{place(predicted):.1f}" cy="{side - place(measured):.1f}" r="3" fill="{color}" fill-opacity="0.6"/>')
    for i, (name, color) in enumerate(COLORS.items()):
        lines.append(f'<circle cx="14" cy="{16 + 18 * i}" r="4" fill="{color}"/><text x="24" y="{20 + 18 * i}">tolerance {name}</text>')
    lines += [
        f'<text x="{side / 2}" y="{side + 40}" text-anchor="middle">predicted error over tolerance</text>',
        f'<text transform="translate(-44 {side / 2}) rotate(-90)" text-anchor="middle">largest measured error over tolerance</text>',
        "</g></svg>",
    ]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--every", type=int, default=5)
    parser.add_argument("--binary", type=pathlib.Path, default=HERE.parent.parent / "target/release/stereomist")
    options = parser.parse_args()
    binary = str(options.binary.resolve())
    rows = [measure(binary, number) for number in range(0, 200, options.every)]
    with open(HERE / "speed.csv", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(COLUMNS)
        out.writerows([[short(x, 4) if isinstance(x, float) else x for x in row] for row in rows])
    start = COLUMNS.index("ratio") + 1
    pairs = []
    for i, tolerance in enumerate(TOLERANCES.values()):
        pairs.append([(row[start + 2 * i] / tolerance, row[start + 2 * i + 1] / tolerance) for row in rows])
    (HERE / "predicted.svg").write_text(chart(pairs))
    lines = []
    kinds = {
        "all": lambda row: True,
        "one colour, no wall": lambda row: row[3] == 1 and not row[5],
        "one colour, wall": lambda row: row[3] == 1 and row[5],
        "several colours, no wall": lambda row: row[3] > 1 and not row[5],
        "several colours, wall": lambda row: row[3] > 1 and row[5],
    }
    for name, kind in kinds.items():
        ratios = sorted(row[COLUMNS.index("ratio")] for row in rows if kind(row))
        if ratios:
            lines.append([name, len(ratios), *(short(x, 3) for x in (statistics.median(ratios), ratios[0], ratios[-1]))])
    factors = sorted(math.exp(abs(math.log(row[-2] / row[-1]))) for row in rows)
    under = sum(measured > predicted for shares in pairs for predicted, measured in shares)
    header = ["scenes", "number", "median of auto's time over the best other's", "least", "greatest"]
    text = table(header, lines) + f"\n\nThe measured error is above the predicted one in {under} of {3 * len(rows)} cases."
    half, most = (short(factors[int(share * len(factors))], 2) for share in (0.5, 0.9))
    text += f"\nThe predicted time of the gas is within a factor of {half} of the measured one for half of the scenes, of {most} for nine in ten."
    put(HERE / "README.md", "speed", text)
    print(text)


if __name__ == "__main__":
    main()
