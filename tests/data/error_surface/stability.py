#!/usr/bin/env python3
"""Error surfaces where their formulas are hard to compute: 50-digit values, made with mpmath from the definitions alone.

    python3 stability.py > stability.csv

Every input is a number of single precision, so that all precisions are asked the same question. Columns:
  case, name            what is hard about the row, and its own name
  of, component, first, second, a, b, cx, cy, cz, radius, near, interocular     the question
  exact                 the error by definition (both points built with vectors, projected, subtracted) to 50 digits; empty
                        where a point is not in front of an eye, or an eye is inside the ball of `perspective`
  condition             sum over the inputs p of |p de/dp| / |e|: by how much a relative change of the inputs may grow; inf
                        where e = 0
  printed               the paper's printed formula, evaluated to 50 digits; empty where it has none or at its pole
"""

import sys

import mpmath as mp
import numpy as np

mp.mp.dps = 90  # differences of nearly equal numbers and numerical derivatives need more than the 50 that are written

INPUTS = ["a", "b", "cx", "cy", "cz", "radius", "near", "interocular"]


def unit(v):
    length = mp.sqrt(sum(x * x for x in v))
    return [x / length for x in v], length


def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def place(alignment, p, cx):
    """Projection of the point (a, b) of a billboard at (cx, cy, cz), or None."""
    c = [cx, p["cy"], p["cz"]]
    a, b = p["a"] * p["radius"], p["b"] * p["radius"]
    to_eye = [-x for x in c]
    across = cross([mp.mpf(0), mp.mpf(1), mp.mpf(0)], to_eye)
    u = unit(across)[0] if any(across) else [mp.mpf(1), mp.mpf(0), mp.mpf(0)]
    n, distance = unit(to_eye)
    v = cross(n, u)
    offset = [a * u[i] + b * v[i] for i in range(3)]
    if alignment == "viewplane":
        point = [c[0] + a, c[1] + b, c[2]]
    elif alignment == "viewpoint":
        point = [c[i] + offset[i] for i in range(3)]
    else:
        if not any(offset):
            point = c
        else:
            direction, length = unit(offset)
            if length >= distance:
                return None
            angle = mp.asin(length / distance)
            point = [-mp.cos(angle) * n[i] + mp.sin(angle) * direction[i] for i in range(3)]
    if not (c[2] < 0 and point[2] < 0):
        return None
    return p["near"] * point[0] / -point[2], p["near"] * point[1] / -point[2]


def projection(q, p, cx):
    first, second = place(q["first"], p, cx), place(q["second"], p, cx)
    if first is None or second is None:
        return None
    axis = "xy".index(q["component"])
    return zero_or(first[axis] - second[axis], first[axis])


def zero_or(difference, of):
    """What is left of numbers that are equal but for the rounding of the working precision is zero."""
    return mp.mpf(0) if abs(difference) < abs(of) * mp.mpf(10) ** (10 - mp.mp.dps) else difference


def error(q, p):
    if q["of"] == "projection":
        return projection(q, p, p["cx"])
    right, left = projection(q, p, p["cx"] - p["interocular"] / 2), projection(q, p, p["cx"] + p["interocular"] / 2)
    return None if right is None or left is None else right - left


def printed_projection(q, p, cx):
    cy, cz, r, near = p["cy"], p["cz"], p["radius"], p["near"]
    s = mp.sqrt(cx * cx + cz * cz)
    if cz >= 0 or -cz * s + r * cx <= 0:
        return None
    if q["component"] == "x":
        return near * r * (cx * cx - cz * s + r * cx - cz * cz) / (-cz * (-cz * s + r * cx))
    return near * r * cx * cy * s / (cz * (cz * s - r * cx))


def printed(q, p):
    if (q["first"], q["second"], p["a"], p["b"]) != ("viewplane", "viewpoint", 1, 0):
        return None
    if q["of"] == "projection":
        return printed_projection(q, p, p["cx"])
    right, left = (printed_projection(q, p, p["cx"] + side * p["interocular"] / 2) for side in (-1, 1))
    return None if right is None or left is None else right - left


def condition(q, p, value):
    if value == 0:
        return mp.inf
    total = mp.mpf(0)
    for name in INPUTS:
        if p[name] == 0 or (name == "interocular" and q["of"] == "projection"):
            continue
        # A central difference with a step so small that its own error is below the digits written, and a working
        # precision that leaves enough of the difference.
        with mp.workdps(150):
            step = abs(p[name]) * mp.mpf(10) ** -45
            at = []
            for side in (-1, 1):
                moved = dict(p)
                moved[name] = p[name] + side * step
                at.append(error(q, moved))
            if None in at:
                return mp.inf
            total += abs(p[name] * (at[1] - at[0]) / (2 * step))
    return total / abs(value)


def single(value):
    return float(np.float32(value))


ROWS = []


def row(case, name, of="projection", component="x", first="viewplane", second="viewpoint", point=(1, 0),
        c=(0.7, 0.3, -2.0), radius=0.4, near=1.0, interocular=0.065):
    question = {"case": case, "name": name, "of": of, "component": component, "first": first, "second": second}
    numbers = dict(zip(INPUTS, map(single, (*point, *c, radius, near, interocular))))
    ROWS.append((question, numbers))


ASKED = [(of, component) for of in ("projection", "parallax") for component in "xy"]
CORNER, LEFT, TOP, INNER = (1, 1), (-1, 0), (0, 1), (0.37, -0.81)
PAIRS = [("viewplane", "viewpoint"), ("viewplane", "perspective"), ("viewpoint", "perspective")]


def rows():
    for of, component in ASKED:
        ask = {"of": of, "component": component}
        for first, second in PAIRS:
            pair = {"first": first, "second": second, **ask}
            row("typical", "the check value's billboard", **pair)
            for name, point in [("corner", CORNER), ("left edge", LEFT), ("top edge", TOP), ("inner point", INNER)]:
                row("typical", name, point=point, **pair)
            row("typical", "left of the eye", c=(-1.3, -0.6, -2.5), point=CORNER, **pair)
        # Poles: d s = r C_x exactly at r = 3.75 (C_x = 4, d = 3, s = 5).
        for k in (1, 4, 8, 12, 16, 20):
            row("pole d s = r C_x", f"r below by 2^-{k}", c=(4, 1, -3), radius=3.75 * (1 - 2.0**-k), interocular=1e-4, **ask)
        row("pole d s = r C_x", "at the pole", c=(4, 1, -3), radius=3.75, **ask)
        row("pole d s = r C_x", "past the pole", c=(4, 1, -3), radius=4, **ask)
        for k in (4, 10, 20, 40, 60):
            row("pole d = 0", f"d = 2^-{k}, left edge", c=(0.7, 0.3, -(2.0**-k)), point=LEFT, **ask)
        row("pole d = 0", "d = 2^-20, right edge, past the other pole", c=(0.7, 0.3, -(2.0**-20)), **ask)
        row("pole d = 0", "d = 0", c=(0.7, 0.3, 0), point=LEFT, **ask)
        row("pole d = 0", "behind the eye", c=(0.7, 0.3, 1), point=LEFT, **ask)
        # The eye inside the billboard's ball: viewplane and viewpoint still have points in front.
        for name, point in [("left edge", LEFT), ("right edge", (1, 0)), ("inner point", INNER), ("top edge", TOP)]:
            row("eye inside", name, c=(0.1, 0.05, -0.2), radius=0.5, interocular=0.01, point=point, **ask)
        row("eye inside", "perspective has no point", c=(0.1, 0.05, -0.2), radius=0.5, second="perspective", **ask)
        row("eye inside", "radius nearly the distance", c=(0.1, 0.05, -0.2), radius=0.229128, second="perspective",
            point=LEFT, interocular=1e-3, **ask)
        # The middle: e_x vanishes with C_x.
        for k in (4, 10, 20, 30, 60):
            row("C_x -> 0", f"C_x = 2^-{k}", c=(2.0**-k, 0.3, -2), interocular=2.0**-k, **ask)
            row("C_x -> 0", f"C_x = 2^-{k}, I = 0.065", c=(2.0**-k, 0.3, -2), **ask)
        for first, second in PAIRS:
            for k in (10, 20, 30, 60):
                for name, point in [("top edge", TOP), ("inner point", INNER), ("right edge", (1, 0))]:
                    row("C_x -> 0", f"C_x = 2^-{k}, I = 0.065, {name}", c=(2.0**-k, 0.5, -2), point=point, first=first,
                        second=second, **ask)
        row("C_x -> 0", "C_x = 0", c=(0, 0.3, -2), **ask)
        row("C_x -> 0", "C_x = 0, corner", c=(0, 0.3, -2), point=CORNER, **ask)
        for d in (1e2, 1e3, 1e4, 1e5, 1e6):
            row("far away", f"d = {d:.0e}", c=(0.5 * d, 0.3 * d, -d), **ask)
            row("far away", f"d = {d:.0e}, C_x = 0.7", c=(0.7, 0.3, -d), **ask)
            row("far away", f"d = {d:.0e}, inner point", c=(0.5 * d, 0.3 * d, -d), point=INNER, **ask)
        row("far away", "C_x = 1e6, d = 5", c=(1e6, 0.3, -5), interocular=1, **ask)
        row("far away", "C_y = 1e6, d = 5", c=(0.7, 1e6, -5), point=LEFT, **ask)
        for r in (1e-3, 1e-6, 1e-10, 1e-15):
            row("r -> 0", f"r = {r:.0e}", radius=r, **ask)
            row("r -> 0", f"r = {r:.0e}, corner against perspective", radius=r, point=CORNER, second="perspective", **ask)
        for degrees in (60, 75, 85, 89, 89.9):
            t = float(mp.tan(mp.radians(degrees)))
            row("wide field", f"{degrees} degrees off axis", c=(2 * t, 0.6, -2), radius=0.02, interocular=0.01, **ask)
            row("wide field", f"{degrees} degrees off axis, left", c=(-2 * t, 0.6, -2), interocular=0.01, **ask)
            row("wide field", f"{degrees} degrees up", c=(0.7, 2 * t, -2), radius=0.02, interocular=0.01, point=CORNER, **ask)
        for delta in (0.1, 1e-2, 1e-4):
            row("own zero", f"C_x = -0.42 (1 + {delta:g}), near e_x = 0 for a = 1", c=(-0.42 * (1 + delta), 0.3, -0.5),
                radius=0.4, **ask)
    for component in "xy":
        for interocular in (0.065, 1e-2, 1e-4, 1e-6, 1e-9, 1e-15):
            ask = {"of": "parallax", "component": component, "interocular": interocular}
            row("I -> 0", f"I = {interocular:g}", **ask)
            row("I -> 0", f"I = {interocular:g}, C_x = 0", c=(0, 0.3, -2), **ask)
            row("I -> 0", f"I = {interocular:g}, corner", point=CORNER, **ask)
            row("I -> 0", f"I = {interocular:g}, viewpoint against perspective", point=INNER, first="viewpoint",
                second="perspective", **ask)
        row("I -> 0", "I = 0", of="parallax", component=component, interocular=0)


def text(value):
    """Shortest digits of a single-precision number, which read back exactly in double precision too."""
    return repr(value)


def main():
    rows()
    out = sys.stdout
    out.write("case,name,of,component,first,second," + ",".join(INPUTS) + ",exact,condition,printed\n")
    for question, numbers in ROWS:
        p = {name: mp.mpf(value) for name, value in numbers.items()}
        value, as_printed = error(question, p), printed(question, p)
        cells = [f'"{question["case"]}"', f'"{question["name"]}"']
        cells += [question[key] for key in ("of", "component", "first", "second")]
        cells += [text(numbers[name]) for name in INPUTS]
        cells.append("" if value is None else mp.nstr(value, 50))
        cells.append("" if value is None else mp.nstr(condition(question, p, value), 6))
        cells.append("" if as_printed is None else mp.nstr(as_printed, 50))
        out.write(",".join(cells) + "\n")


main()
