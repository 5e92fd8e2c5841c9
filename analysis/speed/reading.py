#!/usr/bin/env python3
"""Measures how fast stereomist reads files of ten million particles, and how much memory rendering them takes.

    pip install numpy
    python3 analysis/speed/reading.py    # about five minutes and 3 GB of temporary files; rewrites reading.csv and README.md

Options: --count N (default 10,000,000), --rounds N (default 5), --no-build, --keep FOLDER (leaves the files there).

One cloud is written in every format. A measurement is the stage `load` that `render --json` states at 16x12 pixels: from
opening the file to a checked set of particles in world space, colours decoded. Beside it stands how fast the same file is
copied from the system's cache into a buffer and nothing is done with it, in the same round. Peak memory is that of the
whole program rendering 1024x768 in stereo.
"""

import argparse
import csv
import json
import re
import resource
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
TARGET_MB_PER_S = 100
TARGET_PEAK_MB = 1000


def cloud(count):
    """Single-precision places, radii and opacities, and bytes of colour."""
    random = np.random.default_rng(17)
    place = random.uniform([-3, -2, -3], [3, 2, 3], (count, 3)).astype("f4")
    radius = random.uniform(0.01, 0.03, count).astype("f4")
    opacity = random.uniform(0.005, 0.03, count).astype("f4")
    color = random.integers(0, 256, (count, 3), dtype="u1")
    return place, radius, opacity, color


def records(place, radius, opacity, color, order):
    kind = np.dtype([("x", order + "f4"), ("y", order + "f4"), ("z", order + "f4"), ("radius", order + "f4"),
                     ("opacity", order + "f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
    rows = np.empty(len(place), kind)
    for i, name in enumerate("xyz"):
        rows[name] = place[:, i]
    rows["radius"], rows["opacity"] = radius, opacity
    for i, name in enumerate(["red", "green", "blue"]):
        rows[name] = color[:, i]
    return rows


def write_ply(path, data, order):
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {name} 1.0\nelement vertex {len(data[0])}\n"
    head += "".join(f"property float {p}\n" for p in ["x", "y", "z", "radius", "opacity"])
    head += "".join(f"property uchar {p}\n" for p in ["red", "green", "blue"]) + "end_header\n"
    with open(path, "wb") as file:
        file.write(head.encode())
        records(*data, order).tofile(file)


def write_npy(path, data):
    np.save(path, records(*data, "<"))


def write_vtk(path, data):
    place, radius, opacity, color = data
    count = len(place)
    with open(path, "wb") as file:
        file.write(b"# vtk DataFile Version 3.0\nparticles\nBINARY\nDATASET POLYDATA\n")
        file.write(f"POINTS {count} float\n".encode())
        place.astype(">f4").tofile(file)
        file.write(f"\nPOINT_DATA {count}\n".encode())
        for name, values in [("radius", radius), ("opacity", opacity)]:
            file.write(f"SCALARS {name} float 1\nLOOKUP_TABLE default\n".encode())
            values.astype(">f4").tofile(file)
            file.write(b"\n")
        file.write(b"COLOR_SCALARS rgb 3\n")
        color.tofile(file)
        file.write(b"\n")


def write_vtp(path, data, compressed):
    place, radius, opacity, color = data
    arrays = [("Points", "Float32", 3, place), ("radius", "Float32", 1, radius), ("opacity", "Float32", 1, opacity),
              ("rgb", "UInt8", 3, color)]
    blocks, offsets, offset = [], [], 0
    for _, _, _, values in arrays:
        raw = values.tobytes()
        if compressed:
            size = 1 << 15
            parts = [zlib.compress(raw[at:at + size], 1) for at in range(0, len(raw), size)]
            head = struct.pack(f"<{3 + len(parts)}Q", len(parts), size, len(raw) % size, *map(len, parts))
            block = head + b"".join(parts)
        else:
            block = struct.pack("<Q", len(raw)) + raw
        offsets.append(offset)
        offset += len(block)
        blocks.append(block)
    tags = [f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{n}" format="appended" offset="{at}"/>'
            for (name, kind, n, _), at in zip(arrays, offsets)]
    compressor = ' compressor="vtkZLibDataCompressor"' if compressed else ""
    with open(path, "wb") as file:
        file.write(f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
                   f'header_type="UInt64"{compressor}>\n<PolyData>\n<Piece NumberOfPoints="{len(place)}" '
                   f'NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="0">\n<PointData>\n'
                   f'{"".join(tags[1:])}\n</PointData>\n<Points>{tags[0]}</Points>\n</Piece>\n</PolyData>\n'
                   f'<AppendedData encoding="raw">\n_'.encode())
        for block in blocks:
            file.write(block)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def write_csv(path, data):
    place, radius, opacity, color = data
    with open(path, "w", encoding="ascii") as file:
        file.write("x,y,z,radius,opacity,r,g,b\n")
        for at in range(0, len(place), 1 << 16):
            part = slice(at, at + (1 << 16))
            rows = zip(place[part].tolist(), radius[part].tolist(), opacity[part].tolist(), color[part].tolist())
            file.writelines(f"{p[0]:.6g},{p[1]:.6g},{p[2]:.6g},{r:.4g},{o:.4g},{c[0] / 255:.4g},{c[1] / 255:.4g},{c[2] / 255:.4g}\n"
                            for p, r, o, c in rows)


def write_vdb(path, count, compressed):
    """A dense fog volume of about `count` voxels, all active: OpenVDB file version 224, tree 5-4-3."""
    leaves = max(1, round((count ** (1 / 3)) / 8))

    def text(value):
        return struct.pack("<I", len(value)) + value.encode()

    def values(array, mask_code=6):
        raw = array.astype("<f4").tobytes()
        if not compressed:
            return bytes([mask_code]) + raw
        small = zlib.compress(raw, 1)
        # A negative size says that what follows is not compressed.
        packed = struct.pack("<q", len(small)) + small if len(small) < len(raw) else struct.pack("<q", -len(raw)) + raw
        return bytes([mask_code]) + packed

    random = np.random.default_rng(5)
    topology, buffers = [], []
    upper = range(0, leaves, 512)
    topology.append(struct.pack("<I", 1) + struct.pack("<fII", 0.0, 0, len(upper) ** 3))
    all_on = b"\xff" * 64
    for ux in upper:
        for uy in upper:
            for uz in upper:
                mids = [(mx, my, mz) for mx in range(32) for my in range(32) for mz in range(32)
                        if max(ux + 16 * mx, uy + 16 * my, uz + 16 * mz) < leaves]
                mask = np.zeros(32768, bool)
                mask[[(x << 10) | (y << 5) | z for x, y, z in mids]] = True
                topology.append(struct.pack("<3i", 8 * ux, 8 * uy, 8 * uz))
                topology.append(np.packbits(mask, bitorder="little").tobytes() + bytes(4096))
                topology.append(values(np.zeros(32768)))
                for mx, my, mz in mids:
                    corner = (ux + 16 * mx, uy + 16 * my, uz + 16 * mz)
                    inside = [(x, y, z) for x in range(16) for y in range(16) for z in range(16)
                              if max(corner[0] + x, corner[1] + y, corner[2] + z) < leaves]
                    mask = np.zeros(4096, bool)
                    mask[[(x << 8) | (y << 4) | z for x, y, z in inside]] = True
                    topology.append(np.packbits(mask, bitorder="little").tobytes() + bytes(512))
                    topology.append(values(np.zeros(4096)))
                    for x, y, z in inside:
                        topology.append(all_on)
                        place = [8 * (c + d) + np.arange(8) for c, d in zip(corner, (x, y, z))]
                        smooth = (np.sin(place[0] * 0.05)[:, None, None] + np.sin(place[1] * 0.07)[None, :, None]
                                  + np.sin(place[2] * 0.06)[None, None, :]) / 6 + 0.5
                        noise = random.integers(0, 256, (8, 8, 8)) / 65536
                        buffers.append(all_on + values(smooth + noise))
    scale = 6.0 / (8 * leaves)
    flags = 1 if compressed else 0
    head = struct.pack("<QIIIB", 0x56444220, 224, 10, 0, 1) + b"00000000-0000-0000-0000-000000000000"
    head += struct.pack("<II", 0, 1) + text("density") + text("Tree_float_5_4_3") + text("")
    grid = struct.pack("<II", flags, 1) + text("class") + text("string") + text("fog volume")
    grid += text("UniformScaleMap")
    for factor in [scale, scale, 1 / scale, 1 / scale ** 2, 0.5 / scale]:
        grid += struct.pack("<3d", factor, factor, factor)
    start = len(head) + 24
    block = start + len(grid) + sum(map(len, topology))
    end = block + sum(map(len, buffers))
    with open(path, "wb") as file:
        file.write(head + struct.pack("<3q", start, block, end) + grid)
        file.writelines(topology)
        file.writelines(buffers)


def run(command):
    """The program's JSON and its peak memory in MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        script = ("import json,resource,subprocess,sys\n"
                  "done=subprocess.run(sys.argv[1:],stdout=subprocess.PIPE)\n"
                  "peak=resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss/1024\n"
                  "print(json.dumps([done.returncode,peak,done.stdout.decode()]))")
        done = subprocess.run([sys.executable, "-c", script, *command, "-o", folder], stdout=subprocess.PIPE, check=True)
    del before
    code, peak, text = json.loads(done.stdout)
    if code != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {code}")
    return json.loads(text), peak * 1024 * 1024 / 1e6


def copy_rate(path):
    """MB/s of reading the file into a buffer and doing nothing with it."""
    buffer = bytearray(1 << 18)
    start = time.perf_counter()
    with open(path, "rb", buffering=0) as file:
        while file.readinto(buffer):
            pass
    return path.stat().st_size / 1e6 / (time.perf_counter() - start)


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--count", type=int, default=10_000_000)
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--no-build", action="store_true")
    options.add_argument("--keep", type=Path)
    args = options.parse_args()
    if not args.no_build:
        subprocess.run(["cargo", "build", "--release", "--locked"], cwd=ROOT, check=True)
    program = ROOT / "target/release/stereomist"
    folder = args.keep or Path(tempfile.mkdtemp(prefix="stereomist-reading-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        data = cloud(args.count)
        formats = [
            ("CSV", "cloud.csv", lambda path: write_csv(path, data), False),
            ("PLY, little endian", "little.ply", lambda path: write_ply(path, data, "<"), True),
            ("PLY, big endian", "big.ply", lambda path: write_ply(path, data, ">"), True),
            ("VTK, binary", "cloud.vtk", lambda path: write_vtk(path, data), True),
            ("VTP, raw", "raw.vtp", lambda path: write_vtp(path, data, False), True),
            ("VTP, zlib", "zlib.vtp", lambda path: write_vtp(path, data, True), True),
            ("NPY, structured", "cloud.npy", lambda path: write_npy(path, data), True),
            ("VDB, not compressed", "raw.vdb", lambda path: write_vdb(path, args.count, False), True),
            ("VDB, zip", "zip.vdb", lambda path: write_vdb(path, args.count, True), True),
        ]
        measured = {name: {"rate": [], "copy": [], "peak": [], "ms": []} for name, *_ in formats}
        for name, file, write, _ in formats:
            path = folder / file
            if not path.exists():
                print(f"writing {name}", file=sys.stderr)
                write(path)
            scene = "[camera]\nposition = [0.0, 0.0, 9.0]\nlook_at = [0.0, 0.0, 0.0]\n[stereo]\nconvergence = 9.0\n"
            scene += f'[[particles]]\nfile = "{file}"\n'
            if file.endswith(".vdb"):
                scene += "position = [-3.0, -3.0, -3.0]\n"
            path.with_name(f"{path.name}.toml").write_text(scene)
        for number in range(args.rounds):
            for name, file, _, _ in formats:
                path = folder / file
                copy = copy_rate(path)
                record, _ = run([program, "render", f"{path}.toml", "--json", "--size", "16x12"])
                ms = dict(record["timings_ms"])["load"]
                measured[name]["ms"].append(ms)
                measured[name]["rate"].append(path.stat().st_size / 1e3 / ms)
                measured[name]["copy"].append(copy)
                print(f"round {number + 1}: {name}: {measured[name]['rate'][-1]:.0f} MB/s", file=sys.stderr)
        for name, file, _, _ in formats:
            record, peak = run([program, "render", f"{folder / file}.toml", "--json"])
            measured[name]["peak"] = peak
            measured[name]["count"] = record["settings"]["particles"]
            measured[name]["total"] = dict(record["timings_ms"])["total_before_writing"]
        head = ["format", "particles", "file MB", "load ms", "MB/s", "million particles/s", "copy MB/s", "peak MB", "render ms"]
        rows = []
        for name, file, _, binary in formats:
            m = measured[name]
            ms, rate = statistics.median(m["ms"]), statistics.median(m["rate"])
            rows.append([name, m["count"], round((folder / file).stat().st_size / 1e6, 1), round(ms, 1), round(rate),
                         round(m["count"] / ms / 1e3, 1), round(statistics.median(m["copy"])), round(m["peak"]), round(m["total"])])
            if binary and rate < TARGET_MB_PER_S:
                print(f"{name}: {rate:.0f} MB/s, wanted {TARGET_MB_PER_S}", file=sys.stderr)
            if m["peak"] > TARGET_PEAK_MB:
                print(f"{name}: {m['peak']:.0f} MB, wanted {TARGET_PEAK_MB}", file=sys.stderr)
        if args.count < 1_000_000:
            print(*rows, sep="\n")
            return
        with open(HERE / "reading.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(rows)
        table = ["| " + " | ".join(head) + " |", "|---" + "|--:" * (len(head) - 1) + "|"]
        table += ["| " + " | ".join(f"{cell:,}" if isinstance(cell, (int, float)) else cell for cell in row) + " |" for row in rows]
        readme = HERE / "README.md"
        text = readme.read_text(encoding="utf-8")
        new = "<!-- reading -->\n" + "\n".join(table) + "\n<!-- /reading -->"
        text, found = re.subn(r"<!-- reading -->.*?<!-- /reading -->", lambda _: new, text, flags=re.DOTALL)
        if not found:
            sys.exit("README.md has no place for the table")
        readme.write_text(text, encoding="utf-8")
        print("\n".join(table))
    finally:
        if not args.keep:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
