"""Reads map.exr with the OpenEXR library and holds it against map.glb: exit 1 with a sentence if they disagree.

    python check_exr.py map.glb map.exr

Every level's part must have the level's pixel size, cover exactly the pixels whose centres lie in the chart, and hold
exact integer ids: faces that contain their pixel's centre, and taxels (fields above level 0) that are corners of them.
"""
import json
import struct
import sys

import numpy as np
import OpenEXR

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}
NONE = 0xFFFFFFFF


def read_document(path):
    """The JSON document of a .glb, and a function that reads its accessors."""
    data = open(path, "rb").read()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20:20 + length]), data[28 + length:]

    def accessor(index):
        a = document["accessors"][index]
        view = document["bufferViews"][a["bufferView"]]
        kind, width = np.dtype(TYPES[a["componentType"]]), WIDTHS[a["type"]]
        start, row = view.get("byteOffset", 0) + a.get("byteOffset", 0), kind.itemsize * width
        stride = view.get("byteStride", row)
        raw = np.frombuffer(binary, np.uint8, (a["count"] - 1) * stride + row, start)
        rows = np.lib.stride_tricks.as_strided(raw, (a["count"], row), (stride, 1))
        return np.ascontiguousarray(rows).view(kind).reshape(a["count"], width)

    return document, accessor


def read_glb(path):
    document, accessor = read_document(path)
    for mesh in document["meshes"]:
        attributes = mesh["primitives"][0]["attributes"]
        ids = None
        if "_TAXEL_ID" in attributes:
            pair = accessor(attributes["_TAXEL_ID"]).astype(np.uint32)
            ids = pair[:, 0] + (pair[:, 1] << 16 if pair.shape[1] == 2 else 0)
        triangles = accessor(mesh["primitives"][0]["indices"]).reshape(-1, 3).astype(np.int64)
        texture = accessor(attributes["TEXCOORD_0"]).astype(float)
        unsplit = mesh["extras"]["dermatome"].get("unsplit")
        if ids is None:
            # Fields are numbered as the vertices of the uncut level.
            ids = np.arange(len(texture)) if unsplit is None else accessor(unsplit)[:, 0].astype(np.int64)
        yield mesh["name"], texture, triangles, ids, accessor(attributes["POSITION"]).astype(float)


def part_name(name):
    """Names in EXR files are printable ASCII; other bytes of the UTF-8 text are %XX."""
    return "".join(chr(b) if 32 <= b <= 126 and b != 37 else f"%{b:02X}" for b in name.encode())


def signed(a, b, c):
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def coverage(texture, triangles, width, height):
    """(inside, near): pixels whose centre is clearly in a triangle, and pixels too near to an edge to tell."""
    inside, near = np.zeros((height, width), bool), np.zeros((height, width), bool)
    points = texture * [width, height]
    slack = 1e-3
    for corners in points[triangles]:
        low = np.maximum(np.floor(corners.min(0) - 1), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(0) + 1), [width, height]).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        centre = np.stack([x, y], -1)
        distances = []
        for k in range(3):
            a, b = corners[k], corners[(k + 1) % 3]
            distances.append(signed(a, b, centre) / max(np.hypot(*(b - a)), 1e-12))
        # Texture v runs down, so a triangle of positive area on the map is clockwise here.
        least = np.min([-d for d in distances], 0)
        window = np.s_[low[1]:high[1], low[0]:high[0]]
        inside[window] |= least > slack
        near[window] |= np.abs(least) <= slack
    return inside, near & ~inside


def check(name, texture, triangles, ids, positions, part):
    channels = {key: channel.pixels for key, channel in part.channels.items()}
    flat = lambda key: channels[key]
    alpha = flat("A")
    height, width = alpha.shape
    covered = alpha == 1
    if not np.all(covered | (alpha == 0)):
        return "coverage is neither 0 nor 1"
    inside, near = coverage(texture, triangles, width, height)
    if np.any(covered & ~inside & ~near) or np.any(inside & ~covered):
        return f"coverage differs from the chart in {np.sum(covered != inside)} pixels"
    face, taxel = flat("face.id"), flat("taxel.id")
    for key, channel in (("face.id", face), ("taxel.id", taxel)):
        if channel.dtype != np.uint32:
            return f"{key} is {channel.dtype}, not uint32"
        if np.any(channel[~covered] != NONE):
            return f"{key} is set outside the chart"
    if np.any(face[covered] >= len(triangles)):
        return "face.id names a face that does not exist"
    rows, columns = np.nonzero(covered)
    if len(rows):
        corners = texture[triangles[face[covered]]] * [width, height]
        centre = np.column_stack([columns, rows]) + 0.5
        for k in range(3):
            side = -signed(corners[:, k], corners[:, (k + 1) % 3], centre)
            reach = np.hypot(*(corners[:, (k + 1) % 3] - corners[:, k]).T)
            if np.any(side < -1e-3 * np.maximum(reach, 1e-9)):
                return "face.id names a face that does not hold the pixel"
        names, first = np.unique(ids, return_index=True)
        at = np.minimum(np.searchsorted(names, taxel[covered]), len(names) - 1)
        if not np.array_equal(names[at], taxel[covered]):
            return "taxel.id names no taxel"
        there = np.stack([flat(f"position.{axis}")[covered] for axis in "XYZ"], -1).astype(float)
        distance = lambda points: np.linalg.norm(points - there, axis=-1)
        nearest = np.min([distance(positions[triangles[face[covered]][:, k]]) for k in range(3)], 0)
        # Ids that several taxels have name one of them.
        is_unique = len(names) == len(np.unique(positions, axis=0))
        if is_unique and np.any(distance(positions[first[at]]) > nearest + 1e-6):
            return "taxel.id is not the nearest vertex"
    return None


def main(glb, exr):
    parts = {part.name(): part for part in OpenEXR.File(exr, separate_channels=True).parts}
    levels = list(read_glb(glb))
    if len(parts) != len(levels):
        return f"{len(parts)} parts for {len(levels)} levels"
    for name, texture, triangles, ids, positions in levels:
        if part_name(name) not in parts:
            return f"no part {part_name(name)}"
        wrong = check(name, texture, triangles, ids, positions, parts[part_name(name)])
        if wrong:
            return f"{name}: {wrong}"
    print(f"OpenEXR: {len(parts)} parts agree with the map")
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
