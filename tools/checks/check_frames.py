"""Reads every output of a rendered recording with numpy and the OpenEXR library and holds it against map.glb and the
readings: exit 1 with a sentence if they disagree.

    python check_frames.py map.glb readings.csv recording.npz [--extensive] [--frames FOLDER] [--npy FILE PATCH LEVEL]

The readings are a table with the columns `time` and `ID` or `ID.CHANNEL`. The values of every level, the pixels and the
features are computed again from the matrices of map.glb alone: accessors `up` and `direct`, `_AREA` and `TEXCOORD_0`.
Images are those of `linear` interpolation, one part for each patch and level.
"""
import argparse
import csv
import json
import os
import sys

import numpy as np
import OpenEXR

from check_exr import NONE, coverage, part_name, read_document, signed


class Level:
    """One level of a patch, as map.glb has it."""

    def __init__(self, mesh, accessor):
        attributes = mesh["primitives"][0]["attributes"]
        self.extras = mesh["extras"]["dermatome"]
        self.texture = accessor(attributes["TEXCOORD_0"]).astype(float)
        self.triangles = accessor(mesh["primitives"][0]["indices"]).reshape(-1, 3).astype(np.int64)
        self.areas = accessor(attributes["_AREA"])[:, 0].astype(float)
        self.ids = self.present = None
        if "_TAXEL_ID" in attributes:
            pair = accessor(attributes["_TAXEL_ID"]).astype(np.uint32)
            self.ids = pair[:, 0] + (pair[:, 1] << 16 if pair.shape[1] == 2 else 0)
        if "_PRESENT" in attributes:
            self.present = accessor(attributes["_PRESENT"])[:, 0]
        self.up = self.matrix(accessor, "up")
        # Where a map is cut, seam vertices are split: which uncut vertex each one is.
        unsplit = self.extras.get("unsplit")
        count = len(self.texture)
        self.unsplit = np.arange(count) if unsplit is None else accessor(unsplit)[:, 0].astype(np.int64)

    def matrix(self, accessor, name):
        if name not in self.extras or self.extras[name] is None:
            return None
        indices = accessor(self.extras[name]["indices"]).astype(np.int64)
        weights = accessor(self.extras[name]["weights"]).astype(float)
        return indices, weights / weights.sum(1, keepdims=True)


def read_levels(path):
    document, accessor = read_document(path)
    patches = {}
    for mesh in document["meshes"]:
        level = Level(mesh, accessor)
        patches.setdefault(level.extras["patch"], {})[level.extras["level"]] = level
    return {patch: [levels[k] for k in range(len(levels))] for patch, levels in patches.items()}


def read_readings(path):
    """(times, {id: {channel: values}}, channels)."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    header, numbers = rows[0], np.array([[float(x or "nan") for x in row] for row in rows[1:]])
    readings, channels = {}, []
    for column, name in enumerate(header):
        if name == "time":
            continue
        taxel, _, channel = name.partition(".")
        if channel not in channels:
            channels.append(channel)
        readings.setdefault(int(taxel), {})[channel] = numbers[:, column]
    return numbers[:, header.index("time")], readings, channels


def scatter(matrix, values, count):
    """P' times values, for each row of values."""
    indices, weights = matrix
    out = np.zeros((len(values), count))
    for k in range(3):
        np.add.at(out.T, indices[:, k], (values * weights[:, k]).T)
    return out


def restrict(levels, values, extensive):
    """The values of every level: (T, n) each, NaN where nothing is known."""
    unsplit = len(levels[0].areas) if levels[0].up is None else len(levels[0].up[0])
    areas = np.zeros(unsplit)
    areas[levels[0].unsplit] = levels[0].areas
    live = ~np.isnan(values)
    weight = live * (1.0 if extensive else areas)
    amount = np.where(live, values, 0.0) * (1.0 if extensive else areas)
    out = [values]
    for fine, coarse in zip(levels, levels[1:]):
        count = len(coarse.up[0]) if coarse.up is not None else coarse.unsplit.max() + 1
        amount, weight = scatter(fine.up, amount, count), scatter(fine.up, weight, count)
        with np.errstate(invalid="ignore", divide="ignore"):
            known = weight > 0
            out.append(np.where(known, amount if extensive else amount / weight, np.nan))
    return out


def faces_of_pixels(level, width, height):
    """(rows, columns, corners, weights) of the pixels whose centre is clearly inside of a triangle."""
    points = level.texture * [width, height]
    found = []
    for face, corners in enumerate(points[level.triangles]):
        low = np.maximum(np.floor(corners.min(0)), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(0)), [width, height]).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        centre = np.stack([x.ravel() + 0.5, y.ravel() + 0.5], -1)
        a, b, c = corners
        area = signed(a, b, c)
        if area == 0 or not len(centre):
            continue
        weights = np.stack([signed(centre, b, c), signed(centre, c, a), signed(centre, a, b)], -1) / area
        inside = weights.min(1) > 1e-4
        found.append((y.ravel()[inside], x.ravel()[inside], np.full(inside.sum(), face), weights[inside]))
    rows, columns, faces, weights = (np.concatenate(part) for part in zip(*found))
    return rows, columns, level.unsplit[level.triangles[faces]], weights


def close(a, b, scale):
    """Equal but for f32, NaN where NaN is."""
    return np.array_equal(np.isnan(a), np.isnan(b)) and np.nanmax(np.abs(a - b), initial=0) <= 2e-5 * scale + 1e-30


def linear(values, corners, weights):
    """Barycentric values of live corners: (T, pixels)."""
    at = values[:, corners]
    live = ~np.isnan(at)
    total = (live * weights).sum(2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(live.any(2), (np.where(live, at, 0.0) * weights).sum(2) / total, np.nan)


def check_level(key, level, values, arrays, extensive):
    """The values and the image of one level; values[c] is (T, n)."""
    found, valid = arrays[f"{key}.values"], arrays[f"{key}.valid"]
    wanted = np.stack(values, 1)
    scale = np.nanmax(np.abs(wanted), initial=0)
    if found.dtype != np.float32 or found.shape != wanted.shape:
        return f"values are {found.dtype} {found.shape}, not float32 {wanted.shape}"
    if not close(found.astype(float), wanted, scale):
        return f"values differ by up to {np.nanmax(np.abs(found - wanted), initial=0)} at a scale of {scale}"
    if not np.array_equal(valid == 1, ~np.isnan(wanted).any(1)):
        return "valid is not where every channel has a value"
    if f"{key}.image" not in arrays:
        return None
    image, mask, taxels = (arrays[f"{key}.{name}"] for name in ("image", "mask", "taxel_id"))
    height, width = mask.shape
    if image.shape != (len(wanted), wanted.shape[1], height, width):
        return f"image has the shape {image.shape}"
    inside, near = coverage(level.texture, level.triangles, width, height)
    if np.any((mask == 1) & ~inside & ~near) or np.any(inside & (mask == 0)):
        return "the mask differs from the chart"
    if np.any((taxels == NONE) != (mask == 0)):
        return "taxel_id is not set where the mask is"
    rows, columns, corners, weights = faces_of_pixels(level, width, height)
    names = corners if level.ids is None else level.ids[corners]
    if not (names == taxels[rows, columns][:, None]).any(1).all():
        return "taxel_id is no corner of its face"
    pixel = (level.extras["map"]["size"][0] / width) * (level.extras["map"]["size"][1] / height)
    for c in range(wanted.shape[1]):
        if extensive:
            totals = np.nansum(image[:, c][:, mask == 1].astype(float), 1) * pixel
            if not np.allclose(totals, np.nansum(wanted[:, c], 1), rtol=1e-6, atol=1e-9 * max(scale, 1e-30) * wanted.shape[2]):
                return "the image does not keep the total"
        elif not close(image[:, c][:, rows, columns].astype(float), linear(wanted[:, c], corners, weights), scale):
            return "the image differs from the barycentric values"
    return None


def check_features(folder, arrays):
    features = json.load(open(os.path.join(folder, "features.json")))
    for name, feature in features.items():
        array = arrays[feature["info"]["array"]]
        if not name.startswith("observation.tactile.") or feature["dtype"] != str(array.dtype):
            return f"feature {name} has the dtype {feature['dtype']}"
        if feature["shape"] != list(array.shape[1:]) or len(feature["names"]) != array.ndim - 1:
            return f"feature {name} has the shape {feature['shape']}"
    return None


def check_frames(folder, arrays):
    """The EXR sequence against the arrays."""
    files = sorted(name for name in os.listdir(folder) if name.endswith(".exr"))
    for file in files:
        key, frame = file[:-len(".exr")].rsplit(".", 1)
        if f"{key}.image" not in arrays:
            return f"{file}: no array {key}.image"
        image, mask = arrays[f"{key}.image"][int(frame)], arrays[f"{key}.mask"]
        part = OpenEXR.File(os.path.join(folder, file), separate_channels=True).parts[0]
        channels = {name: channel.pixels for name, channel in part.channels.items()}
        note = json.loads(part.header["dermatome"])
        if part.name() != part_name(note["name"]):
            return f"{file}: part {part.name()} is called {note['name']}"
        for c, about in enumerate(note["channels"]):
            name = about["name"] if about["name"] not in ("A", "Y") else f"signal.{about['name']}"
            if not np.array_equal(channels[part_name(name)], image[c], equal_nan=True):
                return f"{file}: channel {name} differs from the array"
        if not np.array_equal(channels["Y"], image[0], equal_nan=True):
            return f"{file}: Y is not the first channel"
        known = (mask == 1) & ~np.isnan(image).any(0)
        if not np.array_equal(channels["A"] == 1, known) or not np.isclose(note["time"], arrays["timestamps"][int(frame)]):
            return f"{file}: A or the time is wrong"
    print(f"OpenEXR: {len(files)} frames agree with the arrays")
    return None


def main(options):
    patches = read_levels(options.map)
    times, readings, channels = read_readings(options.readings)
    arrays = dict(np.load(options.recording))
    if not np.array_equal(arrays["timestamps"], times):
        return "timestamps are not those of the readings"
    if len(arrays["channels"]) != len(arrays["units"]) or len(arrays["channels"]) != len(channels):
        return f"channels {arrays['channels']}, units {arrays['units']} for {channels}"
    count = 0
    for patch, levels in patches.items():
        finest = levels[0]
        ids = np.zeros(finest.unsplit.max() + 1, np.uint32)
        ids[finest.unsplit] = finest.ids
        if not np.array_equal(arrays[f"{patch}.ids"], ids):
            return f"{patch}.ids are not the taxels of the map"
        missing = np.full(len(times), np.nan)
        by_channel = []
        for channel in channels:
            values = np.stack([readings.get(i, {}).get(channel, missing) for i in ids], 1)
            if finest.present is not None:
                present = np.ones(len(ids))
                present[finest.unsplit] = finest.present
                values[:, present != 1] = np.nan
            by_channel.append(restrict(levels, values, options.extensive))
        for k, level in enumerate(levels):
            if f"{patch}.L{k}.values" not in arrays:
                continue
            count += 1
            wrong = check_level(f"{patch}.L{k}", level, [values[k] for values in by_channel], arrays, options.extensive)
            if wrong:
                return f"{patch}.L{k}: {wrong}"
    if count == 0:
        return "no level is in the recording"
    print(f"numpy: {len(times)} frames of {count} levels agree with the map")
    wrong = check_features(os.path.dirname(os.path.abspath(options.recording)), arrays)
    if wrong is None and options.npy:
        file, patch, level = options.npy
        image = arrays[f"{patch}.L{level}.image"]
        image = image[:, 0] if image.shape[1] == 1 else image
        wrong = None if np.array_equal(np.load(file), image, equal_nan=True) else f"{file} differs from the .npz"
    if wrong is None and options.frames:
        wrong = check_frames(options.frames, arrays)
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("readings")
    parser.add_argument("recording")
    parser.add_argument("--extensive", action="store_true", help="the readings are amounts, as forces")
    parser.add_argument("--frames", help="a folder with an EXR sequence of the same recording")
    parser.add_argument("--npy", nargs=3, metavar=("FILE", "PATCH", "LEVEL"), help="one image of the same recording")
    sys.exit(main(parser.parse_args()))
