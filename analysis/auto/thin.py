"""Thin gas of small balls: what products of columns and rows return in place of exact balls, and what they are off.

    python3 analysis/auto/thin.py [--rounds 5] [--binary target/release/stereomist]

`perspective` draws every ball exactly, by the same engine. Frames of the two are measured in turns; errors are the largest on 2,000
random pixels of both eyes. Writes a table of README.md.
"""

import argparse
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

# Particles, radius in the box of scenes/walk-2000.toml, opacity, vertical field of view, tolerance.
CASES = [
    (20_000, 0.035, 0.002, 40, "1/255"),
    (20_000, 0.035, 0.02, 40, "0.02"),
    (100_000, 0.03, 0.001, 40, "1/255"),
    (100_000, 0.03, 0.003, 40, "1/255"),
    (100_000, 0.03, 0.01, 40, "1/255"),
    (100_000, 0.03, 0.01, 40, "0.02"),
    (20_000, 0.02, 0.02, 10, "1/255"),
]


def ask(*command):
    """The JSON that a command prints."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/stereomist")
    options = parser.parse_args()
    binary = options.binary.resolve()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for count, radius, opacity, fov, tolerance in CASES:
            scene = [ROOT / "scenes/walk-2000.toml", "--set", "render.opacity_model=exponential", "--tolerance", tolerance]
            for key, value in (("box.count", count), ("radius", radius), ("opacity", opacity)):
                scene += ["--set", f"particles[0].{key}={value}"]
            scene += ["--set", f"camera.fov_y_deg={fov}"]
            times = {"perspective": [], "auto": []}
            for _ in range(options.rounds):
                for method, own in times.items():
                    bench = ask(binary, "bench", *scene, "--method", method, "--repeat", 11, "--warmup", 2, "--json")
                    own.append(bench["median_ms"])
            more = ["--method", "auto", "--format", "left", "--image", "exr", "--verify", 2000, "--json", "-o", folder]
            drawn = ask(binary, "render", *scene, *more)
            found = drawn["verification"]
            words = [line for line in drawn["plan"] if "taken for parallel" in line]
            share, most = "none", "-"
            if words:
                taken, all_of_them, bound = re.search(r"are (\d+) of (\d+),.* ([\d.e-]+)\.$", words[0]).groups()
                share, most = f"{100 * int(taken) / int(all_of_them):.0f} %", short(float(bound), 2)
            opaque = 1 - found["transmittance"]["where"]["truth"]
            exact, saved = (statistics.median(times[method]) for method in ("perspective", "auto"))
            largest = max(found["largest"], found["transmittance"]["largest"])
            rows.append(
                [f"{count:,} of {radius}, opacity {opacity}, {fov} degrees", tolerance, short(opaque, 2), share]
                + [short(value, 3) for value in (exact, saved)]
                + [most, short(largest, 2)]
            )
            print(*rows[-1], sep=" | ", flush=True)
    header = ["particles", "tolerance", "opacity of the gas at its worst pixel", "balls drawn so"]
    header += ["all exact, ms", "auto, ms", "promised", "largest error"]
    put(HERE / "README.md", "thin", table(header, rows))


if __name__ == "__main__":
    main()
