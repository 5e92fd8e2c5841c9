"""Reads the OpenEXR files that stereomist writes: scan lines, 32-bit floats, run lengths."""

import struct

import numpy as np


def read(path):
    """The channels of a file by name, each an array of height x width."""
    data = path.read_bytes()
    if data[:4] != b"\x76\x2f\x31\x01":
        raise ValueError(f"{path}: no OpenEXR file")
    at, attributes = 8, {}
    while data[at]:
        name, at = text(data, at)
        _, at = text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    at += 1
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    names = channels(attributes["channels"])
    if attributes["compression"] != b"\x01":
        raise ValueError(f"{path}: not compressed by run lengths")
    planes = {name: np.empty((height, width), np.float32) for name in names}
    for offset in struct.unpack_from(f"<{height}Q", data, at):
        y, size = struct.unpack_from("<2i", data, offset)
        row = unpack(data[offset + 8:offset + 8 + size], 4 * width * len(names))
        values = np.frombuffer(row, "<f4").reshape(len(names), width)
        for name, line in zip(names, values):
            planes[name][y - y0] = line
    return planes


def text(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def channels(data):
    at, names = 0, []
    while data[at]:
        name, at = text(data, at)
        (kind,) = struct.unpack_from("<i", data, at)
        if kind != 2:
            raise ValueError(f"channel {name} is not of 32-bit floats")
        names.append(name)
        at += 16
    return names


def unpack(data, size):
    """Run lengths, then differences, then the two halves of every pair of bytes. What did not get shorter stands as it is."""
    if len(data) == size:
        return data
    out, at = bytearray(), 0
    while at < len(data):
        count = data[at] - 256 if data[at] > 127 else data[at]
        if count < 0:
            out += data[at + 1:at + 1 - count]
            at += 1 - count
        else:
            out += data[at + 1:at + 2] * (count + 1)
            at += 2
    steps = np.frombuffer(bytes(out), np.uint8).astype(np.int64)
    steps[1:] -= 128
    values = (np.cumsum(steps) & 255).astype(np.uint8)
    pairs = np.empty(size, np.uint8)
    half = (size + 1) // 2
    pairs[0::2], pairs[1::2] = values[:half], values[half:]
    return pairs.tobytes()
