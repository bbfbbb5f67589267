"""What a map makes of a recording, written into the formats that recordings come in."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dermatome._adapter import level_of, need
from dermatome._arguments import A_MAP, check_kind, mapping_of, one_of, path_of
from dermatome._dermatome import Map
from dermatome._errors import DataError, FileError
from dermatome._whole import whole, written
from dermatome.recordings.areas import AREAS, area_numbers

# The name of the group.
GROUP = "map"
# Bytes of a chunk: those of FTP-1's own writer.
CHUNK = 1 << 21
# The most bytes of features, which lerobot takes at once.
MOST_BYTES = 10**9


def write_oxt(recording: Any, path: Any, map: Any, level: int, areas: Mapping[str, int] | None, side: str) -> None:
    """Images of the areas of a map as one group."""
    np = need("numpy", "zarr")
    path = path_of("path", path)
    check_kind("map", map, Map, A_MAP)
    one_of("side", side, ("right", "left"))
    needed = f"the area, 0 to {len(AREAS) - 1}, of patches of {list(map.patches)[:10]}"
    areas = None if areas is None else mapping_of("areas", areas, needed)
    if areas is not None and not areas:
        raise DataError(f"areas: found none; needed: {needed}")
    for patch, area in (areas or {}).items():
        level_of(map, one_of("areas", patch, list(map.patches)), level)
        if not 0 <= (-1 if (number := whole(area)) is None else number) < len(AREAS):
            raise DataError(f"areas: found {area!r} for {patch!r}; needed: 0 to {len(AREAS) - 1}")
    chosen = _areas_of_regions(np, map) if areas is None else [(patch, int(area)) for patch, area in areas.items()]
    is_archive = Path(path).suffix.lower() == ".zip"
    if not is_archive and Path(path).exists():
        raise FileError(f"{path}: found a file or folder; needed: the name of a new folder", "exists")
    with written(path) as part, (_Archive(part) if is_archive else _Folder(part)) as target:
        images, times, stops = (_Rows(target, name) for name in (f"data/{side}_tactile_data_{GROUP}", "data/timestamps", "meta/episode_ends"))
        renderers: list[Any] = []
        shown: list[Any] = []
        episode: int | None = None
        for part in recording.chunks(map):
            if not renderers:
                renderers = _renderers(map, level, [patch for patch, _ in chosen], part)
                shown = [_shown(np, map, drawn, None if areas else area) for drawn, (_, area) in zip(renderers, chosen)]
            images.add(_images(np, renderers, shown, part.values))
            if part.episode != episode and times.count:
                stops.add(np.array([times.count], "<i8"))
            episode = part.episode
            times.add(part.timestamps.astype("<f8"))
        if not renderers:
            raise DataError(f"{recording.path}: found no frame; needed: one or more")
        stops.add(np.array([times.count], "<i8"))
        for array in (images, times, stops):
            array.end()
        about = {f"{side}_tactile_area_{GROUP}": [area for _, area in chosen], f"{side}_tactile_sensor_{GROUP}": "dermatome"}
        for name, each in {**about, f"{side}_tactile_type_{GROUP}": "matrix", "sub_task_instruction": " "}.items():
            rows = _Rows(target, f"data/{name}")
            rows.add(np.array([each] * times.count))
            rows.end()
        for folder in ("", "data/", "meta/"):
            target.write(f"{folder}.zgroup", b'{"zarr_format": 2}')


def _renderers(map: Any, level: int, patches: list[str], part: Any) -> list[Any]:
    """What draws each patch, with pixels of one size."""
    how: dict[str, Any] = {"channels": len(part.channels), "extensive": part.extensive, "modality": part.modalities(map)}
    numbers = [level_of(map, patch, level).number for patch in patches]
    drawn = [map.renderer(number, patch=patch, **how) for number, patch in zip(numbers, patches)]
    pixel = max(max(each.pixel) for each in drawn)
    return [map.renderer(number, patch=patch, pixel=pixel, **how) for number, patch in zip(numbers, patches)]


def _areas_of_regions(np: Any, map: Any) -> list[tuple[str, int]]:
    """The patch with most taxels of each area that a region of the map is named as, and the number of the area."""
    numbers, names = area_numbers(map, None), list(map.patches)
    found = sorted({int(number) for number in numbers if number >= 0})
    return [(names[np.bincount(map.patch_of[numbers == number]).argmax()], number) for number in found]


def _shown(np: Any, map: Any, renderer: Any, area: int | None) -> Any:
    """Which pixels of an image show its area, and the rows and columns around them; of no area the whole image."""
    mask = renderer.mask
    if area is None:
        return mask, (slice(None), slice(None))
    # The number of the field in the whole level, whose region is the one with the largest weight.
    mask = mask & (np.array([*_region_areas(map), -1])[renderer.region] == area)
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        raise DataError(f"areas: found no pixel of {AREAS[area]!r}; needed: a finer level, or a larger region")
    return mask, (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))


def _region_areas(map: Any) -> list[int]:
    """The number of the area of each region, -1 for none."""
    return [AREAS.index(name) if name in AREAS else -1 for name in map.regions]


def _images(np: Any, renderers: list[Any], shown: list[Any], values: Any) -> Any:
    """The images of all areas, (T, areas, H, W), or (T, areas, H, W, C) of several channels."""
    sizes = [mask[box].shape for mask, box in shown]
    height, width = (max(size[axis] for size in sizes) for axis in (0, 1))
    made = np.zeros((len(values), len(renderers), values.shape[1], height, width), "<f4")
    for k, (renderer, (mask, box), size) in enumerate(zip(renderers, shown, sizes)):
        drawn = renderer(values)
        # No skin is 0, as in other recordings; a missing reading stays NaN.
        drawn[:, :, ~mask] = 0
        made[:, k, :, : size[0], : size[1]] = drawn[(..., *box)]
    return made[:, :, 0] if values.shape[1] == 1 else np.moveaxis(made, 2, -1)


class _Folder:
    """A Zarr folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.mkdir()

    def __enter__(self) -> _Folder:
        return self

    def write(self, name: str, data: bytes) -> None:
        (self.path / name).parent.mkdir(parents=True, exist_ok=True)
        (self.path / name).write_bytes(data)

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        pass


class _Archive:
    """A Zarr archive."""

    def __init__(self, path: Path) -> None:
        self.archive = zipfile.ZipFile(path, "w")

    def __enter__(self) -> _Archive:
        return self

    def write(self, name: str, data: bytes) -> None:
        # The same bytes on another day.
        self.archive.writestr(zipfile.ZipInfo(name), data)

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self.archive.close()


class _Rows:
    """An array of Zarr 2 that grows along its first axis."""

    def __init__(self, target: _Folder | _Archive, name: str) -> None:
        self.target, self.name, self.kept, self.count, self.written = target, name, [], 0, 0  # type: ignore[var-annotated]
        self.codec = need("numcodecs", "zarr").Blosc("zstd", 5, shuffle=2)

    def add(self, rows: Any) -> None:
        np = need("numpy", "zarr")
        self.kept.append(rows)
        self.count += len(rows)
        self.size = max(1, CHUNK // max(rows.dtype.itemsize * math.prod(rows.shape[1:]), 1))
        while sum(map(len, self.kept)) >= self.size:
            whole = np.concatenate(self.kept)
            self._write(whole[: self.size])
            self.kept = [whole[self.size :]]

    def _write(self, rows: Any) -> None:
        np = need("numpy", "zarr")
        key = ".".join([str(self.written), *["0"] * (rows.ndim - 1)])
        self.target.write(f"{self.name}/{key}", bytes(self.codec.encode(np.ascontiguousarray(rows))))
        self.written += 1

    def end(self) -> None:
        np = need("numpy", "zarr")
        rows = np.concatenate(self.kept)
        if len(rows):
            self._write(np.concatenate([rows, np.zeros((self.size - len(rows), *rows.shape[1:]), rows.dtype)]))
        about = {
            "zarr_format": 2,
            "shape": [self.count, *rows.shape[1:]],
            "chunks": [self.size, *rows.shape[1:]],
            "dtype": rows.dtype.str,
            "compressor": self.codec.get_config(),
            "fill_value": "" if rows.dtype.kind == "U" else 0,
            "order": "C",
            "filters": None,
        }
        self.target.write(f"{self.name}/.zarray", json.dumps(about).encode())
        self.target.write(f"{self.name}/.zattrs", b"{}")


def write_lerobot(recording: Any, path: Any, map: Any, level: int | str, repo_id: str | None) -> Any:
    """A copy of a dataset with features of the fields of a map."""
    np = need("numpy", "lerobot")
    root = Path(recording.path)
    if not (root / "meta/info.json").is_file():
        raise DataError(f"{root}: found no LeRobot dataset; needed: a recording of one; write_oxt writes others")
    if recording.episode is not None:
        raise DataError(f"{root}: found episode={recording.episode}; needed: all episodes: a feature has a value in each frame")
    if Path(path).exists():
        raise FileError(f"{path}: found a file or folder; needed: the name of a new folder", "exists")
    dataset_module = need("lerobot.datasets.lerobot_dataset", "lerobot")
    tools = need("lerobot.datasets.dataset_tools", "lerobot")
    kept: dict[str, list[Any]] = {}
    shapes: dict[str, Any] = {}
    size = 0
    for part in recording.chunks(map):
        for name, feature in part.features(map, level).items():
            rows = {name: feature["values"], f"{name}.valid": feature["valid"].astype(np.float32)}
            for key, values in rows.items():
                kept.setdefault(key, []).append(values)
                shapes[key] = values.shape[1:]
                size += values.nbytes
        if size > MOST_BYTES:
            raise DataError(f"{root}: found more than {MOST_BYTES} bytes of features; needed: a coarser level, which has fewer fields")
    features = {
        key: (np.concatenate(rows), {"dtype": "float32", "shape": list(shapes[key]), "names": None}) for key, rows in kept.items()
    }
    name = repo_id or root.resolve().name
    copy = f"{name}_map" if repo_id is None else repo_id
    source = dataset_module.LeRobotDataset(name, root=root)
    with written(path) as part:
        tools.add_features(source, features=features, output_dir=part, repo_id=copy)
        # add_features leaves out their statistics, without which policies do not normalise them.
        arrays, about = ({key: each[k] for key, each in features.items()} for k in (0, 1))
        made = need("lerobot.datasets.compute_stats", "lerobot").compute_episode_stats(arrays, about)
        file = part / "meta/stats.json"
        known: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
        known |= {key: {word: np.asarray(numbers).tolist() for word, numbers in each.items()} for key, each in made.items()}
        file.write_text(json.dumps(known, indent=4))
    return dataset_module.LeRobotDataset(copy, root=Path(path))
