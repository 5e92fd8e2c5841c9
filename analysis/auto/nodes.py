"""How far nodes can be trusted: what a cubic spline through nodes is off, by what nodes and their neighbours tell.

    pip install numpy
    python3 analysis/auto/nodes.py [--pictures 1500] [--seed 1]

Pictures of one tile, 4 x 4 cells of nodes, with 1 to 60 balls of a kernel, thin to opaque, six in ten with their rims through
the tile. The transmittance is computed at the nodes and at every eighth of a cell; the spline is that of
src/render/cpu/adaptive/enlarge.rs, the misfit that of misfit.rs, whose constants are below and were chosen by this. Writes a table of README.md.
"""

import argparse
import math
import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

erf = np.vectorize(math.erf)
# Cells along the tile, nodes beyond it on every side, pixels along a cell.
CELLS, MARGIN, PIXELS = 4, 5, 8
# Least radius in nodes, share of the misfit, and that share per unit of optical depth.
TRUST = {"gaussian": (3.5, 0.2), "beliaev": (4.0, 0.35), "linear": (3.0, 0.7), "poly": (3.0, 0.55)}
DENSE = 0.06
# Of a root at a rim: the largest error of the spline, and what bounds of several rims are taken for more.
KINK, MORE = 0.35, 1.1


def chord(u_square):
    return np.sqrt(np.maximum(1 - u_square, 0))


def linear(u_square):
    half, u = chord(u_square), np.sqrt(np.maximum(u_square, 1e-12))
    return half - u_square * np.arcsinh(half / u)


# Footprints over u^2, and the factor of their root at the rim.
KERNELS = {
    "gaussian": (lambda v: np.exp(-4.5 * v) * erf(3 / math.sqrt(2) * chord(v)) / math.erf(3 / math.sqrt(2)), 0.02666),
    "beliaev": (lambda v: np.exp(-8 * v) * erf(math.sqrt(8) * chord(v)) / math.erf(math.sqrt(8)), 0.00107),
    "linear": (linear, 0.0),
    "poly": (lambda v: chord(v) ** 5, 0.0),
}


def spline(t):
    u = 1 - t
    return [u**3 / 6, (3 * t - 6) * t * t / 6 + 2 / 3, (3 * u - 6) * u * u / 6 + 2 / 3, t**3 / 6]


NODES = np.arange(-MARGIN, CELLS + 1 + MARGIN)
PLACES = (np.arange(CELLS * PIXELS) + 0.5) / PIXELS
WEIGHTS = np.zeros((len(PLACES), len(NODES)))
for row, place in zip(WEIGHTS, PLACES):
    first = int(place) - 1 + MARGIN
    row[first : first + 4] = spline(place - int(place))


def coefficients(values, five):
    """From two neighbours on each side, or from one; what wraps around is beyond what the tile asks for."""
    for axis in (0, 1):
        second = lambda v: np.roll(v, 1, axis) + np.roll(v, -1, axis) - 2 * v
        difference = second(values)
        values = values - difference / 6 + (second(difference) / 36 if five else 0)
    return values


def misfit(values):
    worst = 0.0
    for axis in (0, 1):
        near, far = (np.roll(values, k, axis) + np.roll(values, -k, axis) for k in (1, 3))
        off = np.abs(values - (9 * near - far) / 16)
        worst = max(worst, off[MARGIN : -MARGIN, MARGIN : -MARGIN].max())
    return worst


def picture(dice, kernel):
    """The spline's errors with five and with three nodes, the misfit, what rims are bounded by, and the greatest depth."""
    footprint, slope = KERNELS[kernel]
    count = dice.choice([1, 1, 2, 3, 5, 8, 20, 60])
    least = TRUST[kernel][0]
    size = (1,) if dice.random() < 0.5 else (count,)
    radius = np.broadcast_to(least * np.exp(dice.uniform(0, 1, size) * dice.choice([0.2, 0.8, 2.0])), count)
    depth = math.exp(dice.uniform(math.log(0.02), math.log(5))) * dice.uniform(0.5, 1, count)
    centre = dice.uniform(-radius, CELLS + radius, (2, count))
    angle, point = dice.uniform(0, 2 * math.pi, count), dice.uniform(0, CELLS, (2, count))
    through = point + radius * np.array([np.cos(angle), np.sin(angle)])
    centre = np.where(dice.random(count) < 0.6, through, centre)

    def field(at):
        sum = 0.0
        for x, y, r, d in zip(*centre, radius, depth):
            square = ((at[:, None] - x) ** 2 + (at[None, :] - y) ** 2) / r**2
            # The hull of what is inside, so that erf is asked for no more.
            inside = square < 1
            part = np.zeros(square.shape)
            if inside.any():
                part[inside] = d * footprint(square[inside])
            sum = sum + part
        return np.exp(-sum)

    nodes, truth = field(NODES.astype(float)), field(PLACES)
    errors = [np.abs(WEIGHTS @ coefficients(nodes, five) @ WEIGHTS.T - truth).max() for five in (True, False)]
    own = nodes[MARGIN : -MARGIN, MARGIN : -MARGIN]
    wide = nodes[MARGIN - 1 : 1 - MARGIN, MARGIN - 1 : 1 - MARGIN]
    crosses = np.hypot(*(np.clip(centre, 0, CELLS) - centre)) < radius + 1
    rims = (KINK * slope * depth) ** 2 * 2 / radius
    rims = MORE * own.max() * math.sqrt(rims[crosses].sum())
    return *errors, misfit(nodes), rims, -math.log(max(wide.min(), 1e-38))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    lines = []
    for kernel, (least, share) in TRUST.items():
        dice = np.random.default_rng(options.seed)
        five, three, off, rims, depth = np.array([picture(dice, kernel) for _ in range(options.pictures)]).T
        said = np.hypot(np.maximum(share, DENSE * depth) * off, rims)
        # What is off by less than a quarter of a step of 1/1023 is of no account.
        counts = said > 0.25 / 1023
        shares, before = (five / said)[counts], (three / said)[counts]
        numbers = [np.quantile(shares, 0.5), np.quantile(shares, 0.95), shares.max(), np.quantile(before, 0.95), before.max()]
        lines.append([kernel, short(least, 2), short(share, 2), str(counts.sum()), *(short(x, 2) for x in numbers)])
    header = ["kernel", "least radius, nodes", "share of the misfit", "pictures"]
    header += ["error over what is said: median", "95 %", "largest", "from three nodes: 95 %", "largest"]
    put(HERE / "README.md", "nodes", table(header, lines))
    print(table(header, lines))


if __name__ == "__main__":
    main()
