#!/usr/bin/env python3
"""Writes watertower.gltf, watertower.bin, ground.png and tank.png next to itself.

A water tower 5.2 units tall on a piece of meadow, y up, its feet at y = 0 around x = z = 0. The standard library is
all it needs, and every run writes the same bytes.
"""

import json
import math
import os
import struct
import zlib

HERE = os.path.dirname(os.path.abspath(__file__))
TAU = 2 * math.pi

# ---------------------------------------------------------------------------------------------------------- vectors


def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def mul(a, s):
    return tuple(x * s for x in a)


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    return mul(a, 1 / math.sqrt(dot(a, a)))


def linear(srgb):
    """Linear light of an sRGB triple: glTF factors and vertex colours are linear."""
    return [round(v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4, 5) for v in srgb]


# ------------------------------------------------------------------------------------------------------------ noise


def grain(*key):
    """A number in [0, 1) that depends on nothing but the key."""
    return zlib.crc32(struct.pack("<%di" % len(key), *key)) / 2**32


def noise(x, y, period, seed):
    """Smooth noise in [0, 1) with a cell of 1, repeating after `period` cells."""
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    g = [[grain((i + a) % period, (j + b) % period, seed) for a in (0, 1)] for b in (0, 1)]
    low = g[0][0] + (g[0][1] - g[0][0]) * u
    return low + (g[1][0] + (g[1][1] - g[1][0]) * u - low) * v


def octaves(x, y, cells, count, seed):
    """Noise over [0, 1) x [0, 1), tileable: `count` octaves from `cells` cells a side."""
    total = sum(noise(x * cells * 2**k, y * cells * 2**k, cells * 2**k, seed + k) / 2**k for k in range(count))
    return total / (2 - 2 ** (1 - count))


# --------------------------------------------------------------------------------------------------------- textures


def write_png(name, width, height, palette, indices):
    """A picture of up to 256 colours, given as sRGB triples in [0, 1]."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"".join(b"\0" + bytes(indices[y * width : (y + 1) * width]) for y in range(height))
    colors = bytes(round(255 * min(max(v, 0), 1)) for color in palette for v in color)
    with open(os.path.join(HERE, name), "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        file.write(chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)))
        file.write(chunk(b"PLTE", colors))
        file.write(chunk(b"IDAT", zlib.compress(rows, 9)))
        file.write(chunk(b"IEND", b""))


def mix(a, b, t):
    return tuple(x + (y - x) * t for x, y in zip(a, b))


def ramp(stops, count):
    """`count` colours along evenly spaced stops."""
    colors = []
    for k in range(count):
        t = k / (count - 1) * (len(stops) - 1)
        i = min(int(t), len(stops) - 2)
        colors.append(mix(stops[i], stops[i + 1], t - i))
    return colors


def write_ground():
    """Meadow: grass with paler tufts and bare earth, tileable."""
    size, shades = 256, 24
    earth = ramp([(0.33, 0.27, 0.19), (0.47, 0.40, 0.28)], shades)
    grass = ramp([(0.20, 0.29, 0.12), (0.34, 0.44, 0.18), (0.53, 0.57, 0.29)], shades)
    indices = []
    for y in range(size):
        for x in range(size):
            u, v = x / size, y / size
            fine = 0.75 * octaves(u, v, 11, 3, 10) + 0.25 * grain(x, y, 99)
            bare = octaves(u, v, 5, 3, 50) + 0.06 * grain(x, y, 77)
            shade = min(int(min(max(1.5 * fine - 0.25, 0), 1) * shades), shades - 1)
            indices.append(shade + (0 if bare > 0.70 else shades))
    write_png("ground.png", size, size, earth + grass, indices)


def write_tank():
    """The tank's wall: painted panels with seams and rivets, a dark band, and rust running down from the seams."""
    width, height, shades = 512, 128, 40
    paint = ramp([(0.50, 0.56, 0.50), (0.72, 0.77, 0.70)], shades)
    band = ramp([(0.13, 0.27, 0.25), (0.22, 0.39, 0.36)], shades)
    rust = ramp([(0.33, 0.20, 0.13), (0.55, 0.42, 0.32)], shades)
    panels, courses = 16, 4
    indices = []
    for y in range(height):
        for x in range(width):
            u, v = x / width, y / height
            column, course = int(u * panels), int(v * courses)
            across = (u * panels) % 1 * width / panels
            down = (v * courses) % 1 * height / courses
            level = 0.62 + 0.16 * (grain(column, course, 3) - 0.5)
            level += 0.30 * (octaves(u, v, 8, 4, 20) - 0.5)
            if across < 1.5 or down < 1.5:
                level -= 0.38
            elif across < 3 or down < 3:
                level += 0.10
            elif (int(across) in (5, 6) and y % 4 < 2) or (int(down) in (5, 6) and x % 4 < 2):
                level -= 0.10
            # Streaks are long in v and narrow in u.
            streak = noise(u * 128, v * 2, 128, 31) * 0.7 + noise(u * 64, v * 3, 64, 32) * 0.45
            row = 0
            if 0.40 < v < 0.60:
                row = 1
            elif streak * (0.55 + 0.45 * down * courses / height) > 0.76:
                row = 2
            indices.append(row * shades + min(max(int(level * shades), 0), shades - 1))
    write_png("tank.png", width, height, paint + band + rust, indices)


# --------------------------------------------------------------------------------------------------------- geometry


class Part:
    """Triangles of one material with their attributes."""

    def __init__(self):
        self.points, self.normals, self.uvs, self.colors, self.corners = [], [], [], [], []

    def vertex(self, point, normal, uv=None, color=None):
        self.points.append(tuple(round(v, 6) for v in point))
        self.normals.append(tuple(round(v, 6) for v in normal))
        if uv:
            self.uvs.append(tuple(round(v, 6) for v in uv))
        if color:
            self.colors.append(tuple(round(v, 5) for v in color))
        return len(self.points) - 1

    def triangle(self, a, b, c):
        """Counter-clockwise as seen from where the normals point, whichever way the corners are given."""
        p, q, r = (self.points[i] for i in (a, b, c))
        facing = cross(sub(q, p), sub(r, p))
        if dot(facing, facing) < 1e-18:
            return
        out = add(add(self.normals[a], self.normals[b]), self.normals[c])
        self.corners.append((a, b, c) if dot(facing, out) > 0 else (a, c, b))

    def quad(self, a, b, c, d):
        self.triangle(a, b, c)
        self.triangle(a, c, d)

    def tube(self, p, q, radius, sides, caps=False):
        """A round bar from p to q."""
        axis = unit(sub(q, p))
        side = unit(cross(axis, (0, 0, 1) if abs(axis[2]) < 0.9 else (1, 0, 0)))
        other = cross(axis, side)
        directions = [
            add(mul(side, math.cos(TAU * k / sides)), mul(other, math.sin(TAU * k / sides))) for k in range(sides)
        ]
        rings = [[self.vertex(add(end, mul(d, radius)), d) for d in directions] for end in (p, q)]
        for k in range(sides):
            n = (k + 1) % sides
            self.quad(rings[0][k], rings[0][n], rings[1][n], rings[1][k])
        for end, facing in ((p, mul(axis, -1)), (q, axis)) if caps else ():
            ring = [self.vertex(add(end, mul(d, radius)), facing) for d in directions]
            for k in range(1, sides - 1):
                self.triangle(ring[0], ring[k], ring[k + 1])

    def box(self, center, half):
        for k in range(3):
            for sign in (-1, 1):
                normal = tuple(sign if i == k else 0 for i in range(3))
                i, j = (k + 1) % 3, (k + 2) % 3
                ring = []
                for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                    offset = [0, 0, 0]
                    offset[k], offset[i], offset[j] = sign * half[k], a * half[i], b * half[j]
                    ring.append(self.vertex(add(center, offset), normal))
                self.quad(*ring)

    def turned(self, rows, sides, uv=None, color=None):
        """A surface of revolution about y. `rows`: radius, height and the normal's radial and upward parts."""
        grid = []
        for row, (radius, y, out, up) in enumerate(rows):
            length = math.hypot(out, up)
            ring = []
            for k in range(sides + 1):
                c, s = math.cos(TAU * k / sides), math.sin(TAU * k / sides)
                ring.append(
                    self.vertex(
                        (radius * c, y, radius * s),
                        (out * c / length, up / length, out * s / length),
                        uv and uv(k, row),
                        color and color(k, row),
                    )
                )
            grid.append(ring)
        for low, high in zip(grid, grid[1:]):
            for k in range(sides):
                self.quad(low[k], low[k + 1], high[k + 1], high[k])

    def ring(self, radius, y, thickness, sides, around):
        """A torus about the y axis."""
        grid = []
        for k in range(sides):
            c, s = math.cos(TAU * k / sides), math.sin(TAU * k / sides)
            loop = []
            for m in range(around):
                a, b = math.cos(TAU * m / around), math.sin(TAU * m / around)
                r = radius + thickness * a
                loop.append(self.vertex((r * c, y + thickness * b, r * s), (a * c, b, a * s)))
            grid.append(loop)
        for k in range(sides):
            for m in range(around):
                n, o = (k + 1) % sides, (m + 1) % around
                self.quad(grid[k][m], grid[n][m], grid[n][o], grid[k][o])


SIDES = 48
TANK_RADIUS, TANK_LOW, TANK_HIGH, TANK_BOTTOM = 1.15, 3.38, 4.52, 2.90
DECK = 3.36
FOOT, SHOULDER = (1.28, 0.0, 1.28), (0.83, 3.34, 0.83)
LEVELS = (0.12, 1.05, 2.0, 2.9)


def on_leg(y):
    """Where the leg's axis stands at a height."""
    return add(FOOT, mul(sub(SHOULDER, FOOT), (y - FOOT[1]) / (SHOULDER[1] - FOOT[1])))


def tank():
    part = Part()
    wall = [(TANK_RADIUS, y, 1, 0) for y in (TANK_LOW, TANK_HIGH)]
    part.turned(wall, SIDES, uv=lambda k, row: (k / SIDES, 1 - row))
    # The bottom is half an ellipsoid; it shows the texture's lowest course, mirrored below the wall.
    depth, steps = TANK_LOW - TANK_BOTTOM, 10
    bowl = []
    for k in range(steps + 1):
        angle = math.pi / 2 * k / steps
        out, down = math.sin(angle), math.cos(angle)
        bowl.append((TANK_RADIUS * out, TANK_LOW - depth * down, out * depth, -down * TANK_RADIUS))
    part.turned(bowl, SIDES, uv=lambda k, row: (k / SIDES, 0.77 + 0.22 * row / steps))
    return part


def roof():
    part = Part()
    eave, lip, apex = 1.30, 4.47, 5.10
    low, high = linear((0.50, 0.20, 0.14)), linear((0.62, 0.29, 0.20))

    def color(k, row):
        return mix(low, high, 0.35 + 0.35 * (k % 2) + 0.3 * grain(k % SIDES, row, 5))

    slope = (apex - lip) / eave
    part.turned([(eave, lip, slope, 1), (0.65, lip + 0.5 * (apex - lip), slope, 1), (0.02, apex, slope, 1)], SIDES, color=color)
    part.turned([(eave, lip - 0.05, 1, 0), (eave, lip, 1, 0)], SIDES, color=lambda k, row: low)
    part.turned([(1.1, lip - 0.05, 0, -1), (eave, lip - 0.05, 0, -1)], SIDES, color=lambda k, row: low)
    # The vent on top.
    vent = [(0.07, apex - 0.05, 1, 0), (0.07, apex + 0.05, 1, 0)]
    part.turned(vent, 16, color=lambda k, row: low)
    part.turned([(0.12, apex + 0.05, 1, 2), (0.0, apex + 0.10, 1, 2)], 16, color=lambda k, row: high)
    part.turned([(0.07, apex + 0.05, 0, -1), (0.12, apex + 0.05, 0, -1)], 16, color=lambda k, row: low)
    return part


def leg():
    part = Part()
    part.tube(FOOT, SHOULDER, 0.075, 12, caps=True)
    return part


def bracing():
    """Struts and crosses between the leg at (+, +) and the one at (-, +)."""
    part = Part()
    left = [mul(on_leg(y), 1) for y in LEVELS]
    right = [(-x, y, z) for x, y, z in left]
    for a, b in list(zip(left, right))[1:]:
        part.tube(a, b, 0.04, 8)
    for k in range(len(LEVELS) - 1):
        part.tube(left[k], right[k + 1], 0.02, 6)
        part.tube(right[k], left[k + 1], 0.02, 6)
    return part


def walkway():
    part = Part()
    inner, outer, low = TANK_RADIUS - 0.02, 1.46, DECK - 0.05
    part.turned([(inner, DECK, 0, 1), (outer, DECK, 0, 1)], SIDES)
    part.turned([(inner, low, 0, -1), (outer, low, 0, -1)], SIDES)
    part.turned([(outer, low, 1, 0), (outer, DECK, 1, 0)], SIDES)
    for k in range(24):
        c, s = math.cos(TAU * (k + 0.5) / 24), math.sin(TAU * (k + 0.5) / 24)
        part.tube((1.43 * c, DECK, 1.43 * s), (1.43 * c, DECK + 0.36, 1.43 * s), 0.014, 6)
    part.ring(1.43, DECK + 0.19, 0.012, SIDES, 6)
    part.ring(1.43, DECK + 0.36, 0.018, SIDES, 6)
    return part


def riser():
    part = Part()
    part.turned([(0.14, 0, 1, 0), (0.14, TANK_BOTTOM + 0.02, 1, 0)], 20)
    part.turned([(0.2, 0.0, 1, 0), (0.2, 0.18, 1, 0)], 20)
    part.turned([(0.2, 0.18, 0, 1), (0.13, 0.18, 0, 1)], 20)
    part.turned([(0.14, TANK_BOTTOM - 0.12, 1, -1), (0.3, TANK_BOTTOM + 0.03, 1, -1)], 20)
    return part


def footing():
    part = Part()
    part.box((FOOT[0], 0.05, FOOT[2]), (0.2, 0.07, 0.2))
    return part


def ground():
    """24 x 24 units, three repeats of the texture; vertex colours hide the repetition."""
    part, cells, half = Part(), 12, 12.0
    for j in range(cells + 1):
        for i in range(cells + 1):
            u, v = i / cells, j / cells
            shade = 0.70 + 0.45 * grain(i, j, 8)
            tint = (shade * (0.94 + 0.12 * grain(i, j, 9)), shade, shade * 0.95)
            part.vertex((half * (2 * u - 1), 0, half * (2 * v - 1)), (0, 1, 0), (3 * u, 3 * v), tint)
    for j in range(cells):
        for i in range(cells):
            a = j * (cells + 1) + i
            part.quad(a, a + 1, a + cells + 2, a + cells + 1)
    return part


# ------------------------------------------------------------------------------------------------------------- glTF


def main():
    write_ground()
    write_tank()
    data, views, accessors, meshes, nodes = bytearray(), [], [], [], []

    def accessor(values, kind, code, component, target):
        data.extend(b"\0" * (-len(data) % 4))
        packed = b"".join(struct.pack("<%d%s" % (len(v), code), *v) for v in values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed), "target": target})
        data.extend(packed)
        entry = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        accessors.append(entry)
        return len(accessors) - 1

    def mesh(name, part, material):
        attributes = {"POSITION": accessor(part.points, "VEC3", "f", 5126, 34962)}
        # A reader may trust these bounds, so they are those of the rounded numbers.
        rounded = [struct.unpack("<3f", struct.pack("<3f", *p)) for p in part.points]
        accessors[-1]["min"] = [min(p[k] for p in rounded) for k in range(3)]
        accessors[-1]["max"] = [max(p[k] for p in rounded) for k in range(3)]
        attributes["NORMAL"] = accessor(part.normals, "VEC3", "f", 5126, 34962)
        if part.uvs:
            attributes["TEXCOORD_0"] = accessor(part.uvs, "VEC2", "f", 5126, 34962)
        if part.colors:
            attributes["COLOR_0"] = accessor(part.colors, "VEC3", "f", 5126, 34962)
        flat = [(i,) for corners in part.corners for i in corners]
        indices = accessor(flat, "SCALAR", "H", 5123, 34963)
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        meshes.append({"name": name, "primitives": [primitive]})
        return len(meshes) - 1

    def four(name, index):
        """The same mesh at the four sides of the tower."""
        for k in range(4):
            half = TAU / 4 * k / 2
            rotation = [0, round(math.sin(half), 9), 0, round(math.cos(half), 9)]
            nodes.append({"name": "%s %d" % (name, k + 1), "mesh": index, "rotation": rotation})

    def material(name, color, texture=None):
        base = {"baseColorFactor": linear(color) + [1], "metallicFactor": 0}
        if texture is not None:
            base["baseColorTexture"] = {"index": texture}
        return {"name": name, "pbrMetallicRoughness": base}

    white = (1, 1, 1)
    # A lamp at the eye would leave the meadow black: it is shown as it is.
    meadow = material("meadow", white, 0)
    meadow["extensions"] = {"KHR_materials_unlit": {}}
    materials = [
        meadow,
        material("painted wall", white, 1),
        material("roof", white),
        material("dark steel", (0.27, 0.29, 0.31)),
        material("galvanised steel", (0.46, 0.48, 0.48)),
        material("concrete", (0.62, 0.60, 0.56)),
    ]
    for name, part, kind in (
        ("ground", ground(), 0),
        ("tank", tank(), 1),
        ("roof", roof(), 2),
        ("walkway", walkway(), 4),
        ("riser", riser(), 4),
    ):
        nodes.append({"name": name, "mesh": mesh(name, part, kind)})
    four("leg", mesh("leg", leg(), 3))
    four("bracing", mesh("bracing", bracing(), 3))
    four("footing", mesh("footing", footing(), 5))
    document = {
        "asset": {"version": "2.0", "generator": "make_watertower.py", "copyright": "MIT OR Apache-2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "textures": [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 1}],
        "images": [{"uri": "ground.png"}, {"uri": "tank.png"}],
        "samplers": [{"magFilter": 9729}, {"magFilter": 9729, "wrapT": 33071}],
        "buffers": [{"uri": "watertower.bin", "byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    with open(os.path.join(HERE, "watertower.bin"), "wb") as file:
        file.write(data)
    with open(os.path.join(HERE, "watertower.gltf"), "w", newline="\n") as file:
        json.dump(document, file, indent=1)
        file.write("\n")


if __name__ == "__main__":
    main()
