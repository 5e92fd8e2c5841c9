"""Rims of large balls, the hardest that nodes are asked: pictures of one tile with 1 to 60 truncated Gaussians whose rims run
through it, at three tolerances, against the reference at every pixel.

    python3 analysis/auto/rims.py [--pictures 300] [--seed 1] [--binary target/release/stereomist]

Prints the largest shares of the tolerance and writes a table of README.md. The constants of src/render/cpu/adaptive/rims.rs were
chosen by it.
"""

import argparse
import json
import math
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

TOLERANCES = [1 / 255, 1 / 1023, 0.02]
COLORS = ["0.9,0.2,0.1", "0.1,0.8,0.2", "0.2,0.3,0.9"]
# Pixels along each side of the picture, and the least radius: 3.5 distances of the widest nodes, and a hair.
SIDE, LEAST = 64, 56.5


def write(folder, dice, kernel, colors):
    """A scene file of balls around distance 4, and what it holds."""
    count = dice.choice([1, 1, 2, 3, 5, 8, 20, 60])
    fov = dice.choice([10, 30, 50])
    focal = SIDE / 2 / math.tan(math.radians(fov / 2))
    opacity = dice.choice([0.02, 0.1, 0.3, 0.6, 0.9, 0.99])
    alike, radius = dice.random() < 0.5, LEAST * math.exp(dice.uniform(0, 2.2))
    rows = ["x,y,z,radius,opacity,r,g,b"]
    for _ in range(count):
        depth = 4 * dice.uniform(0.7, 1.3)
        own = radius if alike else LEAST * math.exp(dice.uniform(0, 2.2))
        if dice.random() < 0.6:
            # The rim runs through a point of the picture or just beside it.
            angle, point = dice.uniform(0, 2 * math.pi), [dice.uniform(-36, 36), dice.uniform(-36, 36)]
            x, y = point[0] + own * math.cos(angle), point[1] + own * math.sin(angle)
        else:
            x, y = (dice.uniform(-own - 30, own + 30) for _ in range(2))
        scale = depth / focal
        color = dice.choice(COLORS) if colors > 1 else "1,1,1"
        own_opacity = opacity * dice.uniform(0.5, 1)
        rows.append(f"{x * scale},{y * scale},{-depth},{1.03 * own * scale},{own_opacity},{color}")
    (folder / "particles.csv").write_text("\n".join(rows) + "\n")
    scene = folder / "scene.toml"
    scene.write_text(
        f"[camera]\nposition = [0, 0, 0]\nlook_at = [0, 0, -1]\nfov_y_deg = {fov}\nsize = [{SIDE}, {SIDE}]\nnear = 0.05\n"
        f'[background]\ncolor = [0, 0, 0]\n[[particles]]\nfile = "particles.csv"\nkernel = "{kernel}"\n'
    )
    return scene, f"{count} balls of {radius:.0f} pixels, opacity {opacity}, {fov} degrees"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kernel", default="gaussian")
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/stereomist")
    options = parser.parse_args()
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for colors in (1, 3):
            dice = random.Random(options.seed)
            found = []
            for _ in range(options.pictures):
                scene, words = write(folder, dice, options.kernel, colors)
                for tolerance in TOLERANCES:
                    more = ["--method", "auto", "--tolerance", tolerance, "--verify", "all", "--image", "exr", "--json"]
                    command = [str(options.binary.resolve()), "render", str(scene), "-o", name, *map(str, more)]
                    done = subprocess.run(command, capture_output=True, text=True)
                    found.append((json.loads(done.stdout)["verification"]["largest"] / tolerance, tolerance, words))
            print(f"{colors} colours, the largest shares of the tolerance:")
            for share, tolerance, words in sorted(found, reverse=True)[:5]:
                print(f"    {share:.2f} of 1/{1 / tolerance:.0f}: {words}")
            for tolerance, label in zip(TOLERANCES, ("1/255", "1/1023", "0.02")):
                shares = sorted(share for share, own, _ in found if own == tolerance)
                numbers = [statistics.median(shares), shares[int(0.95 * len(shares))], shares[-1]]
                beyond = sum(share > 1 for share in shares)
                lines.append([str(colors), label, str(len(shares)), str(beyond), *(short(x, 2) for x in numbers)])
    header = ["colours", "tolerance", "pictures", "beyond it", "median error over tolerance", "95 %", "largest"]
    put(HERE / "README.md", "rims", table(header, lines))


if __name__ == "__main__":
    main()
