"""Does `auto` keep its tolerance? Random scenes against the reference, every pixel of both eyes.

usage: python3 analysis/auto/run.py [--scenes 200] [--binary target/release/stereomist]

Writes results.csv beside itself and the table of README.md. Scenes depend on their number alone; those that are kept in
work/ are not rendered again by the reference.
"""

import argparse
import concurrent.futures
import csv
import json
import math
import pathlib
import random
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

TOLERANCES = {"1/255": 1 / 255, "1/1023": 1 / 1023, "0.02": 0.02}
KERNELS = ["gaussian", "beliaev", "linear", "constant", "poly", "table"]
SIZE = "64x48"
COLUMNS = ["scene", "kernels", "particles", "colors", "inside", "mesh", "tolerance", "error", "alpha_error", "share"]

BOX = """v {0} {1} {2}
v {3} {1} {2}
v {3} {4} {2}
v {0} {4} {2}
f 1 2 3
f 1 3 4
"""


def scene(number, folder):
    """Writes a random scene; returns its file and what it holds."""
    dice = random.Random(number)
    inside = dice.random() < 0.3
    mesh = dice.random() < 0.3
    sets = dice.randint(1, 5)
    kernels = [dice.choice(KERNELS) for _ in range(sets)]
    one = dice.random() < 0.35
    colors = [[round(dice.random(), 3) for _ in range(3)] for _ in range(sets)]
    total = round(math.exp(dice.uniform(0, math.log(2000))))
    half = 1.5
    distance = 0.0 if inside else dice.uniform(2.0, 8.0)
    lines = [
        "[camera]",
        f"position = [0.0, 0.0, {distance:.4f}]",
        "look_at = [0.1, -0.05, -10.0]",
        f"fov_y_deg = {dice.choice([25, 40, 60, 90])}",
        f"near = {dice.choice([0.01, 0.1, 0.4])}",
        "[stereo]",
        "interocular = 0.065",
        f"convergence = {dice.uniform(1.5, 6):.3f}",
        "[background]",
        f"color = [{dice.random():.3f}, {dice.random():.3f}, {dice.random():.3f}]",
    ]
    count = 0
    for i, kernel in enumerate(kernels):
        own = max(1, total // sets)
        count += own
        radius = math.exp(dice.uniform(math.log(0.03), math.log(1.2)))
        # From thin to opaque: so many particles one behind the other, so much optical depth in all.
        behind = own * math.pi * radius**2 / (2 * half) ** 2
        depth = math.exp(dice.uniform(math.log(0.02), math.log(12)))
        opacity = min(0.99, 1 - math.exp(-depth / max(behind, 1.0)))
        color = colors[0 if one else i]
        name = '{ table = "profile.csv" }' if kernel == "table" else f'"{kernel}"'
        lines += [
            "[[particles]]",
            f"radius = {radius:.5f}",
            f"opacity = {opacity:.6f}",
            f"color = {color}",
            f"kernel = {name}",
            "[particles.box]",
            f"min = [-{half}, -{half}, -{half}]",
            f"max = [{half}, {half}, {half}]",
            f"count = {own}",
            f"seed = {number * 10 + i}",
        ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "profile.csv").write_text("q,density\n0,0.2\n0.3,1.0\n0.6,0.5\n0.9,0.1\n1,0\n")
    if mesh:
        x, y = sorted(dice.uniform(-1, 1) for _ in range(2)), sorted(dice.uniform(-1, 1) for _ in range(2))
        (folder / "wall.obj").write_text(BOX.format(x[0], y[0], dice.uniform(-1.4, 1.0), x[1], y[1]))
        lines += ["[[mesh]]", 'file = "wall.obj"', f"color = {[round(dice.random(), 3) for _ in range(3)]}"]
    path = folder / "scene.toml"
    path.write_text("\n".join(lines) + "\n")
    facts = ["+".join(sorted(set(kernels))), count, 1 if one else sets, int(inside), int(mesh)]
    return path, facts


def study(binary, number):
    """The rows of one scene."""
    folder = HERE / "work" / f"{number:03}"
    path, facts = scene(number, folder)
    shared = ["--size", SIZE, "--threads", "1", "--image", "exr", "--format", "left,right", "--quiet"]
    truth = folder / "reference"
    if not (truth / "scene.right.exr").exists():
        subprocess.run([binary, "render", path, "--method", "reference", "-o", truth, *shared], check=True)
    rows = []
    for name, tolerance in TOLERANCES.items():
        drawn = folder / "auto"
        command = [binary, "render", path, "--method", "auto", "--tolerance", repr(tolerance), "-o", drawn, *shared]
        subprocess.run(command, check=True)
        error = alpha = 0.0
        for eye in ("left", "right"):
            pair = [drawn / f"scene.{eye}.exr", truth / f"scene.{eye}.exr"]
            answer = json.loads(subprocess.run([binary, "compare", *pair, "--json"], check=True, capture_output=True).stdout)
            error = max(error, answer["max"])
            alpha = max(alpha, answer["views"][0]["alpha_max"])
        rows.append([number, *facts, name, error, alpha, error / tolerance])
    return rows


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--binary", type=pathlib.Path, default=HERE.parent.parent / "target/release/stereomist")
    options = parser.parse_args()
    binary = str(options.binary.resolve())
    with concurrent.futures.ThreadPoolExecutor() as pool:
        rows = [row for rows in pool.map(lambda number: study(binary, number), range(options.scenes)) for row in rows]
    with open(HERE / "results.csv", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(COLUMNS)
        out.writerows([[short(x, 4) if isinstance(x, float) else x for x in row] for row in rows])
    lines = []
    for name in TOLERANCES:
        shares = sorted(row[-1] for row in rows if row[6] == name)
        worst = max((row for row in rows if row[6] == name), key=lambda row: row[-1])
        lines.append([
            name,
            len(shares),
            sum(share > 1 for share in shares),
            short(statistics.median(shares), 2),
            short(shares[int(0.95 * (len(shares) - 1))], 2),
            short(shares[-1], 2),
            worst[0],
        ])
    header = ["tolerance", "scenes", "beyond it", "median error over tolerance", "95 %", "largest", "of scene"]
    put(HERE / "README.md", "table", table(header, lines))
    print(table(header, lines))


if __name__ == "__main__":
    main()
