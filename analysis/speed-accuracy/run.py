"""Time against error of every method on the scenes of this study.

usage: python3 analysis/speed-accuracy/run.py [--budget SECONDS] [--binary target/release/stereomist]

Runs `stereomist chart`, which resumes where it was, and makes the table of README.md from its CSV files.
"""

import argparse
import csv
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

SCENES = [
    ROOT / "scenes/mist.toml",
    ROOT / "scenes/fog.toml",
    ROOT / "scenes/clouds.toml",
    ROOT / "scenes/inside.toml",
    ROOT / "scenes/katrina.toml",
    HERE / "thin.toml",
    HERE / "colors.toml",
]


def name(row):
    """A point by its method and what of it varies."""
    return row["method"] + (f", {row['parameter']} {row['value']}" if row["parameter"] else "")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--budget", default="60")
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/stereomist")
    options = parser.parse_args()
    subprocess.run([options.binary.resolve(), "chart", *SCENES, "-o", HERE, "--budget", options.budget], check=True)
    lines = []
    for scene in SCENES:
        with open(HERE / f"{scene.stem}.csv", newline="") as file:
            rows = sorted(csv.DictReader(file), key=lambda row: float(row["median_ms"]))
        for row in rows:
            if row["front"] == "yes" or (row["method"], row["value"]) == ("perspective", "1/255"):
                numbers = [short(float(row[key]), 3) for key in ("median_ms", "rmse", "max", "inconsistency_rmse") if row[key]]
                mark = "" if row["front"] == "yes" else " (not on the front)"
                lines.append([scene.stem, name(row) + mark, *numbers])
    header = ["scene", "method", "ms", "RMSE", "largest error", "left-right inconsistency"]
    put(HERE / "README.md", "front", table(header, lines, ["--", "--", "--:", "--:", "--:", "--:"]))


if __name__ == "__main__":
    main()
