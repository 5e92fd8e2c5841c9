"""Does `auto` split the tolerance well? Random gas of two to four colours, drawn by several programs in turns.

usage: python3 analysis/auto/split.py BINARY [BINARY ...] [--every 3]

Prints the time of each over that of the first, the scenes farthest from it first and last, and the mean over all. Build a program with other
shares (`src/render/cpu/adaptive/split.rs`) to compare it with.
"""

import argparse
import json
import math
import pathlib
import random
import statistics
import subprocess
import tempfile

from run import TOLERANCES
from speed import ASIDE

SCENES = 150
KERNELS = ["gaussian", "gaussian", "gaussian", "poly", "beliaev", "linear"]


def scene(number, folder):
    """Writes a scene; returns its file, its tolerance, and what it holds."""
    dice = random.Random(number)
    log = lambda low, high: math.exp(dice.uniform(math.log(low), math.log(high)))
    radius, colors = log(0.2, 1.5), dice.randint(2, 4)
    depth, opacity = log(0.3, 16), log(0.02, 0.6)
    own = -math.log(1 - opacity)
    count = max(20, min(6000, int(depth / (own * 0.22 * math.pi * radius**2) * 40)))
    kernel = dice.choice(KERNELS)
    lines = ["[camera]", "position = [0.0, 0.0, 6.0]", "look_at = [0.0, 0.0, -4.0]", "fov_y_deg = 60"]
    lines += ["[background]", "color = [0.1, 0.2, 0.3]"]
    for i in range(colors):
        color = ", ".join(f"{dice.random():.3f}" for _ in range(3))
        lines += ["[[particles]]", f"radius = {radius:.4f}", f"opacity = {opacity:.4f}", f'kernel = "{kernel}"', f"color = [{color}]"]
        lines += ["[particles.box]", "min = [-4.0, -2.5, -6.0]", "max = [4.0, 2.5, 4.0]"]
        lines += [f"count = {count // colors + 1}", f"seed = {number * 10 + i}"]
    path = folder / f"{number}.toml"
    path.write_text("\n".join(lines) + "\n")
    return path, dice.choice(list(TOLERANCES.values())), f"{count} of {radius:.2f}, {kernel}, opacity {opacity:.3f}"


def gas(binary, path, tolerance):
    """Milliseconds for the gas of a frame."""
    command = [binary, "bench", path, "--method", "auto", "--tolerance", repr(tolerance), "--size", "1024x768", "--mono"]
    command += ["--pixels", "srgb8", "--repeat", "5", "--warmup", "2", "--json"]
    answer = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return sum(time for stage, time in answer["stages"].items() if stage not in ASIDE)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binaries", nargs="+", type=pathlib.Path)
    parser.add_argument("--every", type=int, default=3)
    options = parser.parse_args()
    binaries = [str(path.resolve()) for path in options.binaries]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(0, SCENES, options.every):
            path, tolerance, what = scene(number, pathlib.Path(folder))
            turns = [[gas(binary, path, tolerance) for binary in binaries] for _ in range(3)]
            times = [statistics.median(times) for times in zip(*turns)]
            rows.append(([time / times[0] for time in times[1:]], number, f"{what}, tolerance {tolerance:.2g}", times[0]))
    rows.sort()
    for shares, number, what, time in rows[:8] + rows[-8:]:
        print(f"{number:3}", " ".join(f"{share:.2f}" for share in shares), f"of {time:.2f} ms: {what}")
    means = [math.exp(statistics.fmean(math.log(row[0][i]) for row in rows)) for i in range(len(binaries) - 1)]
    print("mean", " ".join(f"{mean:.3f}" for mean in means))


if __name__ == "__main__":
    main()
