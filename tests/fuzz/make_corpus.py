#!/usr/bin/env python3
"""Makes the seeds of the fuzz targets, tests/fuzz/corpus/TARGET/, from small real files.

    make_corpus.py [DATA [SCENES]]

DATA and SCENES are folders laid out as tests/data and scenes of this repository, which are the defaults. Every seed
but a VDB file is smaller than 4 KB, because a fuzzer changes a random byte and most should matter. Needs nothing but Python's library.
"""

import base64
import json
import pathlib
import shutil
import struct
import sys
import zlib

HERE = pathlib.Path(__file__).resolve().parent
CORPUS = HERE / "corpus"
LARGEST = 4096
# A VDB file of one voxel has 9 KB of masks.
LARGEST_OF = {"vdb": 32768}


def put(target, name, content):
    """Writes one seed."""
    content = content.encode() if isinstance(content, str) else content
    largest = LARGEST_OF.get(target, LARGEST)
    if len(content) >= largest:
        sys.exit(f"{target}/{name} has {len(content)} bytes; allowed: fewer than {largest}")
    folder = CORPUS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content)


def csv(data):
    lines = (data / "dust_disc.csv").read_text().splitlines()
    put("csv", "dust_disc.csv", "\n".join(lines[:8]) + "\n")
    put("csv", "colours.csv", "x,y,z,radius,opacity,r,g,b\n1,2,3,0.5,0.25,1,0.5,0\n-1,-2,-3,0.25,0.75,0,0,1\n")
    put("csv", "dialect.csv", "\ufeff# note\r\n\r\n \"x\" ,y,\"z\"\r\n\" 1\", 2e-3 ,+3.\r4,5,6")


def ply(data):
    header, body = (data / "katrina.ply").read_bytes().split(b"end_header\n", 1)
    lines = [line for line in header.decode().splitlines() if not line.startswith("comment")]
    text = "\n".join(lines).replace("element vertex 309", "element vertex 6") + "\nend_header\n"
    put("ply", "katrina.ply", text.encode() + body[: 6 * 16])
    rows = list(struct.iter_unpack("<4f", body[: 3 * 16]))
    ascii_header = text.replace("binary_little_endian", "ascii").replace("vertex 6", "vertex 3")
    put("ply", "ascii.ply", ascii_header + "".join(f"{x} {y} {z} {v}\n" for x, y, z, v in rows))
    rich = (
        "ply\nformat {} 1.0\ncomment c\nobj_info i\nelement camera 1\nproperty double view\nelement vertex 2\n"
        "property short x\nproperty list uchar float w\nproperty uint8 red\nelement face 1\n"
        "property list int ushort i\nend_header\n"
    )
    for order, name in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        rows = struct.pack(order + "dhBffBhBBiHHH", 7, -300, 2, 0.5, 1.5, 255, 12, 0, 9, 3, 0, 1, 2)
        put("ply", f"lists_{name}.ply", rich.format(name).encode() + rows)
    wide = "".join(f"property char a{i}\n" for i in range(180))
    for name, rows in (("wide", 1), ("claim", 65536)):
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {rows}\n{wide}end_header\n"
        put("ply", f"{name}.ply", header.encode() + bytes(180))
    put("ply", "lists_ascii.ply", rich.format("ascii") + "7\n-300 2 0.5 1.5 255\n12 0 9\n3 0 1 2\n")


def npy(data):
    for path in sorted((data / "npy").glob("*.npy")):
        put("npy", path.name, path.read_bytes())
    # Many columns: memory for rows that are only claimed counts for each of them.
    for name, rows in (("wide", 1), ("claim", 65536)):
        header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({rows}, 200), }}".ljust(117) + "\n"
        put("npy", f"{name}.npy", b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header.encode() + bytes(200))


def png(width, height):
    """A picture of that size: red and green rise, blue is constant."""
    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows = b"".join(b"\0" + bytes(v for x in range(width) for v in (80 * x, 80 * y, 9)) for y in range(height))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def gltf(data):
    """The first triangles of the water tower, within one file."""
    folder = data / "watertower"
    scene = json.loads((folder / "watertower.gltf").read_text())
    buffer = (folder / scene["buffers"][0]["uri"]).read_bytes()

    def elements(index, form):
        accessor = scene["accessors"][index]
        start = scene["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        size = struct.calcsize(form)
        return [struct.unpack_from(form, buffer, start + i * size) for i in range(accessor["count"])]

    primitive = scene["meshes"][0]["primitives"][0]
    corners = [i for (i,) in elements(primitive["indices"], "<H")][:12]
    used = sorted(set(corners))
    parts = [struct.pack(f"<{len(corners)}H", *(used.index(i) for i in corners))]
    accessors = [{"bufferView": 0, "componentType": 5123, "count": len(corners), "type": "SCALAR"}]
    attributes = {}
    for name, kind, form in (("POSITION", "VEC3", "<3f"), ("NORMAL", "VEC3", "<3f"), ("TEXCOORD_0", "VEC2", "<2f")):
        values = elements(primitive["attributes"][name], form)
        attributes[name] = len(parts)
        accessors.append({"bufferView": len(parts), "componentType": 5126, "count": len(used), "type": kind})
        parts.append(b"".join(struct.pack(form, *values[i]) for i in used))
    positions = [elements(primitive["attributes"]["POSITION"], "<3f")[i] for i in used]
    accessors[1]["min"], accessors[1]["max"] = ([pick(axis) for axis in zip(*positions)] for pick in (min, max))
    parts.append(png(3, 2))
    views, start = [], 0
    for part in parts:
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(part)})
        start += -(-len(part) // 4) * 4
    whole = b"".join(part.ljust(-(-len(part) // 4) * 4, b"\0") for part in parts)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "rotation": [0, 0, 0.6, 0.8]}, {"mesh": 0, "scale": [1, 2, 1]}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 0, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 1, 1]}}],
        "textures": [{"sampler": 0, "source": 0}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}],
        "images": [{"bufferView": len(parts) - 1, "mimeType": "image/png"}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(whole)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(whole), b"BIN\0") + whole
    put("gltf", "watertower.glb", struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(whole).decode()
    put("gltf", "watertower.gltf", json.dumps(document, separators=(",", ":")))
    # A strip without indices, sparse, coloured, unlit.
    points = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0) + bytes([255, 0, 0, 255] * 4)
    points += struct.pack("<B3x3f", 2, 5, 5, 5)
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "nodes": [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 4, 5, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "mode": 5, "material": 0}]}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0],
             "sparse": {"count": 1, "indices": {"bufferView": 2, "componentType": 5121},
                        "values": {"bufferView": 3}}},
            {"bufferView": 1, "componentType": 5121, "normalized": True, "count": 4, "type": "VEC4"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in ((0, 48), (48, 16), (64, 4), (68, 12))],
        "buffers": [{"byteLength": 80, "uri": "data:;base64," + base64.b64encode(points).decode()}],
    }
    put("gltf", "strip.gltf", json.dumps(document, separators=(",", ":")))


def scene_file(scenes):
    texts = {path.name: path.read_text() for path in sorted(scenes.glob("*.toml"))}
    for name, text in texts.items():
        put("scene_file", name, text)
    # A NUL stands before every setting.
    sets = ["camera.fov_y_deg=30", "particles.0.radius=0.3", "camera.position=[1, 2, 3]", "render.method=\"x\""]
    put("scene_file", "sets.toml", "\0".join([next(iter(texts.values())), *sets]))


def vtk(data):
    """Legacy and XML files."""
    for path in sorted((data / "vtk").glob("*.vt*")):
        put("vtk" if path.suffix == ".vtk" else "vtp", path.name, path.read_bytes())
    ascii_file = "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"2\"><PointData><DataArray type=\"Float32\" "
    ascii_file += "Name=\"rgb\" NumberOfComponents=\"3\" format=\"ascii\">1 .5 0 0 0 1</DataArray></PointData><Points>"
    ascii_file += "<DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">1 2 3 -1 -2 -3</DataArray></Points>"
    put("vtp", "short.vtp", ascii_file + "</Piece></PolyData></VTKFile>")


def vdb(data):
    for path in sorted((data / "vdb").glob("*.vdb")):
        put("vdb", path.name, path.read_bytes())


def obj(data):
    lines = (data / "watertower" / "watertower.obj").read_text().splitlines()
    kinds = [[line for line in lines if line.split(" ")[0] == kind][:count] for kind, count in
             (("v", 24), ("vt", 20), ("vn", 12))]
    put("obj", "points.obj", "\n".join(sum(kinds, ["mtllib watertower.mtl", "o tower"])) + "\nusemtl a\nf 1/1/1 2/2/1 3/3/1\n"
        "f -1//-1 -2//-2 -3//-3\ns 1\ng a b\nf 1 2 3 4 5 6 7\nl 1 2\np 3\n")
    put("obj", "concave.obj", "v 0 0 0 1 0 0\nv 2 0 0 0 1 0\nv 2 2 0 0 0 1\nv 1 .5 0 1 1 1\nv 0 2 0 1 1 0\nf 1 2 \\\n3 4 5\n")
    put("mtl", "tower.mtl", (data / "watertower" / "watertower.mtl").read_text().replace("citybits_texture", "a"))
    put("mtl", "options.mtl", "newmtl a\nKd .5 .25 1\nd .5\nTr .5\nmap_Kd -s 2 2 1 -o .5 0 0 -clamp on -bm 1 a\\b c.png\nmap_Bump x\n")


def ply_mesh():
    head = ("ply\nformat {} 1.0\ncomment TextureFile a.png\nelement vertex 5\nproperty float x\nproperty float y\n"
            "property float z\nproperty float s\nproperty float t\nproperty uchar red\nproperty uchar green\n"
            "property uchar blue\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n")
    points = [(0, 0), (2, 0), (2, 2), (1, 0.5), (0, 2)]
    text = "".join(f"{x} {y} 0 {x / 2} {y / 2} 255 128 0\n" for x, y in points)
    put("ply_mesh", "ascii.ply", head.format("ascii") + text + "3 0 1 3\n4 0 3 2 4\n")
    for order, name in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        rows = b"".join(struct.pack(order + "5f3B", x, y, 0, x / 2, y / 2, 255, 128, 0) for x, y in points)
        faces = struct.pack(order + "B3iB4i", 3, 0, 1, 3, 4, 0, 3, 2, 4)
        put("ply_mesh", f"{name}.ply", head.format(name).encode() + rows + faces)


def splats():
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0", "opacity", "scale_0", "scale_1", "scale_2",
             "rot_0", "rot_1", "rot_2", "rot_3"]
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    rows = [(1, 2, 3, 0.5, -0.5, 1, 0.1, 2, -3, -2, -1, 1, 0, 0, 0), (0, 0, 0, 0, 0, 0, 0, -4, -5, -5, -5, 0, 1, 0, 0)]
    put("ply", "splats.ply", head.encode() + b"".join(struct.pack("<15f", *row) for row in rows))


def texture():
    def chunk(kind, content):
        body = kind + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"".join(b"\0" + bytes([16 * x, 16 * y, 128] * 1) * 4 for y in range(4) for x in range(1))
    head = struct.pack(">2I5B", 4, 4, 8, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    put("texture", "small.png", png)
    large = struct.pack(">2I5B", 16384, 4096, 8, 2, 0, 0, 0)
    put("texture", "claim.png", png.replace(chunk(b"IHDR", head), chunk(b"IHDR", large)))


def profile():
    put("profile", "header.csv", "q,density\n0,1\n0.5,0.4\n1,0\n")
    put("profile", "plain.csv", "# no header\r\n0,2\r\n\r\n0.25,1.5e0\r\n1,0")


def main():
    data, scenes = HERE.parent / "data", HERE.parent.parent / "scenes"
    given = [pathlib.Path(argument) for argument in sys.argv[1:3]]
    data, scenes = given + [data, scenes][len(given):]
    shutil.rmtree(CORPUS, ignore_errors=True)
    csv(data)
    ply(data)
    npy(data)
    gltf(data)
    vtk(data)
    vdb(data)
    obj(data)
    ply_mesh()
    splats()
    texture()
    scene_file(scenes)
    profile()
    for folder in sorted(CORPUS.iterdir()):
        print(folder.name, *(f"{path.name} ({path.stat().st_size})" for path in sorted(folder.iterdir())))


main()
