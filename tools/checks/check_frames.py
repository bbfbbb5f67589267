"""Reads every output of a rendered recording with numpy and the OpenEXR library and holds it against map.glb and the
readings: exit 1 with a sentence if they disagree.

    python check_frames.py map.glb readings.csv recording.npz [--extensive] [--frames FOLDER] [--npy FILE PATCH LEVEL]

The readings are a table with the columns `time` and `ID` or `ID.CHANNEL[UNIT]`. The values of every level, every pixel and
the features are computed again from the matrices of map.glb alone: accessors `up` and `direct`, `_AREA` and `TEXCOORD_0`.
Where charts are packed, the static channels of the frames say which face each pixel shows; they are held against
`POSITION`.
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
        self.positions = accessor(attributes["POSITION"]).astype(float)
        self.texture = accessor(attributes["TEXCOORD_0"]).astype(float)
        self.triangles = accessor(mesh["primitives"][0]["indices"]).reshape(-1, 3).astype(np.int64)
        self.areas = accessor(attributes["_AREA"])[:, 0].astype(float)
        self.ids = self.present = None
        if "_TAXEL_ID" in attributes:
            pair = accessor(attributes["_TAXEL_ID"]).astype(np.uint32)
            self.ids = pair[:, 0] + (pair[:, 1] << 16 if pair.shape[1] == 2 else 0)
        if "_PRESENT" in attributes:
            self.present = accessor(attributes["_PRESENT"])[:, 0]
        self.up, self.direct = self.matrix(accessor, "up"), self.matrix(accessor, "direct")
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
    for level in levels[1:]:
        count = len(level.up[0]) if level.up is not None else level.unsplit.max() + 1
        sums, weights = scatter(level.direct, amount, count), scatter(level.direct, weight, count)
        with np.errstate(invalid="ignore", divide="ignore"):
            out.append(np.where(weights > 0, sums if extensive else sums / weights, np.nan))
    return out


def faces_of_centres(level, shape):
    """Of each pixel the face that holds its centre, or is nearest to: its least weight, the face, the weights."""
    height, width = shape
    points = level.texture * [width, height]
    best, face_of, weights_of = np.full(shape, -np.inf), np.full(shape, -1), np.zeros((*shape, 3))
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
        better = weights.min(1) > best[y.ravel(), x.ravel()]
        at = y.ravel()[better], x.ravel()[better]
        best[at], face_of[at], weights_of[at] = weights[better].min(1), face, weights[better]
    return best, face_of, weights_of


def faces_of_pixels(level, mask):
    """(rows, columns, corners, weights) of the covered pixels: the face that holds the centre of each."""
    best, face_of, weights_of = faces_of_centres(level, mask.shape)
    rows, columns = np.nonzero(mask)
    if np.any(best[rows, columns] < -0.05):
        sys.exit("a covered pixel lies in no face")
    return rows, columns, level.unsplit[level.triangles[face_of[rows, columns]]], weights_of[rows, columns]


def close(a, b, scale):
    """Equal but for f32, NaN where NaN is."""
    return np.array_equal(np.isnan(a), np.isnan(b)) and np.nanmax(np.abs(a - b), initial=0) <= 2e-5 * scale + 1e-30


def normalised(weights, live):
    """Weights of the live entries with sum 1, and where there is one."""
    weights = np.where(live, np.maximum(weights, 0), 0)
    total = weights.sum(1, keepdims=True)
    return weights / np.where(total > 0, total, 1), total[:, 0] > 0


def draw(values, corners, weights, pixel, extensive):
    """(T, pixels) of values (T, n), linear between the corners."""
    live = ~np.isnan(values[0])
    if not np.array_equal(np.isnan(values), np.broadcast_to(~live, values.shape)):
        sys.exit("taxels come and go: this check wants the same ones in all frames")
    values = np.where(live, values, 0.0)
    live_corners = live[corners]
    # Faces without a dead corner extrapolate by rounding at most; others are cut off at 0.
    kept, known = normalised(weights, live_corners)
    kept = np.where(live_corners.all(1)[:, None], weights, kept)
    known |= live_corners.any(1)
    scale = np.ones(values.shape[1])
    if extensive:
        seen = np.bincount(corners.ravel(), (kept * known[:, None]).ravel(), len(scale))
        if np.any(seen[live] < 1e-3):
            sys.exit("a value that no pixel shows: this check wants smaller pixels")
        scale = 1 / (pixel * np.where(live, seen, 1))
    image = ((values * scale)[:, corners] * kept).sum(2)
    image[:, ~known] = np.nan
    return image


def vertices_named(shown, taxels, corners, weights):
    """The vertices that pixels name, of which no corner of the face is nearer; None where ids are not unique."""
    of_level = np.arange(shown.unsplit.max() + 1) if shown.ids is None else shown.ids
    names, first = np.unique(of_level, return_index=True)
    if len(names) < len(of_level):
        return None
    at = np.minimum(np.searchsorted(names, taxels), len(names) - 1)
    if not np.array_equal(names[at], taxels):
        sys.exit("taxel_id names no taxel")
    vertices, places = first[at], np.zeros((len(of_level), 3))
    places[shown.unsplit] = shown.positions
    there = (places[corners] * weights[:, :, None]).sum(1)
    farther = np.linalg.norm(places[vertices] - there, axis=1) - np.linalg.norm(places[corners] - there[:, None], axis=2).min(1)
    if farther.max(initial=0) > 1e-6:
        sys.exit("taxel_id is not the nearest vertex")
    return vertices


def check_level(key, levels, k, values, arrays, options):
    """The values and the image of level `k`; values[c] is (T, n)."""
    extensive = options.extensive
    shown = levels[k]
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
    inside, near = coverage(shown.texture, shown.triangles, width, height)
    if np.any((mask == 1) & ~inside & ~near) or np.any(inside & (mask == 0)):
        return "the mask differs from the chart"
    if np.any((taxels == NONE) != (mask == 0)):
        return "taxel_id is not set where the mask is"
    if not np.isnan(image[:, :, mask == 0]).all():
        return "the image has values off the skin"
    rows, columns, corners, weights = faces_of_pixels(shown, mask)
    vertices_named(shown, taxels[rows, columns], corners, weights)
    size = shown.extras["map"]["size"]
    step = arrays.get("metres_per_pixel", arrays.get(f"{key}.metres_per_pixel"))
    if not np.allclose(np.array(size) / [width, height], step, rtol=1e-9):
        return f"metres_per_pixel is {step}, and the map says {np.array(size) / [width, height]}"
    pixel = size[0] / width * size[1] / height
    for c in range(wanted.shape[1]):
        found = image[:, c][:, rows, columns].astype(float)
        if extensive:
            totals = np.nansum(found, 1) * pixel
            if not np.allclose(totals, np.nansum(wanted[:, c], 1), rtol=1e-6, atol=1e-9 * max(scale, 1e-30) * wanted.shape[2]):
                return "the image does not keep the total"
        drawn = draw(wanted[:, c], corners, weights, pixel, extensive)
        if not close(found, drawn, np.nanmax(np.abs(drawn), initial=0)):
            return f"the image differs from the linear values by up to {np.nanmax(np.abs(found - drawn))}"
    return None


def check_features(recording, arrays):
    features = json.load(open(os.path.splitext(recording)[0] + ".features.json"))
    for name, feature in features.items():
        array, valid = (arrays[feature["info"][key]] for key in ("array", "valid"))
        if feature["info"]["units"] != list(arrays["units"]) or feature["info"]["channels"] != list(arrays["channels"]):
            return f"feature {name} has the units {feature['info']['units']}, not {arrays['units']}"
        if not name.startswith("observation.tactile.") or "/" in name or feature["dtype"] != str(array.dtype):
            return f"feature {name} has the dtype {feature['dtype']}"
        if feature["shape"] != [array[0].size] or feature["names"] is not None or valid.shape != array[:, 0].shape:
            return f"feature {name} has the shape {feature['shape']}"
        if not np.isfinite(np.where(valid[:, None] == 1, array, feature["info"]["missing"])).all():
            return f"feature {name} is not finite"
    return None


def check_shown(patches, level, channels, image, mask, values, options):
    """The static channels of a frame against the map, and its pixels against the values that they name."""
    face, bary = channels["face.id"].astype(np.int64), np.stack([channels["bary.U"], channels["bary.V"]], -1).astype(float)
    position = np.stack([channels[f"position.{axis}"] for axis in "XYZ"], -1).astype(float)
    rows, columns = np.nonzero(channels["face.id"] != NONE)
    if not np.array_equal(channels["face.id"] != NONE, mask == 1):
        return "the mask of the arrays is not where a face is shown"
    weights = np.column_stack([1 - bary[rows, columns].sum(1), bary[rows, columns]])
    seen = np.zeros(len(rows), bool)
    for patch, levels in patches.items():
        # A patch without the level shows its coarsest.
        own = min(level, len(levels) - 1)
        shown = levels[own]
        of_patch = np.flatnonzero(face[rows, columns] < len(shown.triangles))
        corners = shown.triangles[face[rows, columns][of_patch]]
        there = (shown.positions[corners] * weights[of_patch][:, :, None]).sum(1)
        mine = np.abs(there - position[rows, columns][of_patch]).max(1) < 1e-6
        of_patch, corners = of_patch[mine], shown.unsplit[corners[mine]]
        at = rows[of_patch], columns[of_patch]
        vertices_named(shown, channels["taxel.id"][at], corners, weights[of_patch])
        normal = np.stack([channels[f"normal.{axis}"][at] for axis in "XYZ"], -1)
        if not np.allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5):
            return f"{patch}: normals are not of length 1"
        pixel = options.pixel ** 2
        for c, of_channel in enumerate(values[patch]):
            drawn = draw(of_channel[own], corners, weights[of_patch], pixel, options.extensive)
            if not close(image[c][at][None].astype(float), drawn[options.frame][None], np.nanmax(np.abs(drawn), initial=0)):
                return f"{patch}: pixels differ from the values of the map"
        seen[of_patch] = True
    return None if seen.all() else f"{(~seen).sum()} pixels show no place of the map"


def check_frames(folder, arrays, patches, values, options):
    """The EXR sequence against the arrays and, with static channels, against the map."""
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
        units = [about["unit"] for about in note["channels"]], [about["value_unit"] for about in note["channels"]]
        if [list(arrays["image_units"]), list(arrays["units"])] != list(units):
            return f"{file}: units {units} are not those of the arrays"
        if {about["quantity"] for about in note["channels"]} != {"extensive" if options.extensive else "intensive"}:
            return f"{file}: wrong quantity"
        if "face.id" in channels:
            options.frame, options.pixel = int(frame), note["metres_per_pixel"]
            wrong = check_shown(patches, int(key.rsplit("L", 1)[1]), channels, image, mask, values, options)
            if wrong:
                return f"{file}: {wrong}"
        elif options.packed:
            return f"{file}: no static channels"
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
    for unit, of_image in zip(arrays["units"], arrays["image_units"]):
        if of_image != (f"{unit or '1'}/m^2" if options.extensive else unit):
            return f"images are in {of_image!r}, and values in {unit!r}"
    count, drawn = 0, {}
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
        drawn[patch] = by_channel
        for k in range(len(levels)):
            if f"{patch}.L{k}.values" not in arrays:
                continue
            count += 1
            wrong = check_level(f"{patch}.L{k}", levels, k, [values[k] for values in by_channel], arrays, options)
            if wrong:
                return f"{patch}.L{k}: {wrong}"
    if count == 0:
        return "no level is in the recording"
    print(f"numpy: {len(times)} frames of {count} levels agree with the map")
    wrong = check_features(options.recording, arrays)
    if wrong is None and options.npy:
        file, patch, level = options.npy
        image = arrays[f"{patch}.L{level}.image"]
        image = image[:, 0] if image.shape[1] == 1 else image
        wrong = None if np.array_equal(np.load(file), image, equal_nan=True) else f"{file} differs from the .npz"
    if wrong is None and options.frames:
        wrong = check_frames(options.frames, arrays, patches, drawn, options)
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("map")
    parser.add_argument("readings")
    parser.add_argument("recording", nargs="?")
    parser.add_argument("--packed", action="store_true", help="the frames are packed and have static channels")
    parser.add_argument("--extensive", action="store_true", help="the readings are amounts, as forces")
    parser.add_argument("--frames", help="a folder with an EXR sequence of the same recording")
    parser.add_argument("--npy", nargs=3, metavar=("FILE", "PATCH", "LEVEL"), help="one image of the same recording")
    sys.exit(main(parser.parse_args()))
