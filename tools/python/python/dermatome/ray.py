"""Contacts and recordings on a cluster: batches of Ray Data."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._arguments import items_of, mapping_of, one_of, path_of, whole_of
from dermatome._dermatome import Index, Layout, Map
from dermatome._errors import DataError, Error, FileError
from dermatome._readings import Readings
from dermatome._recording import layout_of
from dermatome._whole import written

__all__ = ["Lookup", "Render", "episodes", "total", "touch_counts"]


def _map_of(map: Any) -> Map:
    """The map of a file, or of the bytes of one."""
    return Map.from_bytes(map) if isinstance(map, bytes) else Map.read(path_of("map", map, "a path, or Map.to_bytes()"))


def _options_of(renderer: Any) -> dict[str, Any]:
    """Arguments of `Map.renderer`, but those that follow from the recording."""
    known = [name for name in inspect.signature(Map.renderer).parameters if name not in ("self", "level", "channels", "extensive", "modality")]
    return {one_of("renderer", name, known): value for name, value in mapping_of("renderer", renderer, "a dict of arguments of Map.renderer").items()}


def _plain(value: Any) -> Any:
    """What a value says, as JSON has it: of a map and a layout all that is in them."""
    if isinstance(value, Map):
        return hashlib.sha256(value.to_bytes()).hexdigest()
    if isinstance(value, Layout):
        return value.text
    return value.tolist() if hasattr(value, "tolist") else repr(value)


class Lookup:
    """The cells of a batch of contacts: for `map_batches` with `batch_format="pyarrow"` and an actor for each worker.

    It adds the columns `patch`, `field`, `taxel_id`, `distance`, `u` and `v` to a table with `x`, `y` and `z` (m).

    Parameters
    ----------
    map : str, os.PathLike or bytes
        A `map.glb` that every worker can read, or `Map.to_bytes()`.
    level : int
        The level of the cells.
    threads : int
        Threads of one worker.

    Raises
    ------
    MissingFileError, FileError
        If the map does not exist, or cannot be read.
    DataError
        If the map has no such level, or a row is no place: the message says which.
    """

    def __init__(self, map: str | os.PathLike[str] | bytes, level: int = 0, threads: int = 1) -> None:
        read = _map_of(map)
        self.level, self.threads = whole_of("level", level, "the number of a level"), threads
        read.n_fields(self.level)  # A level that the map does not have is refused here, not in a worker.
        self.index: Index = read.index(threads=threads)

    def __call__(self, batch: Any) -> Any:
        np, arrow = need("numpy", "ray"), need("pyarrow", "ray")
        points = np.column_stack([batch[name].to_numpy() for name in ("x", "y", "z")])
        hits = self.index.locate(points, level=self.level, threads=self.threads)
        if hits.uv is None:
            raise DataError(f"level: found {self.level!r}, which has no map; needed: the number of a level")
        columns = {
            "patch": hits.patch,
            "field": hits.field,
            "taxel_id": hits.taxel_id,
            "distance": hits.distance,
            "u": np.ascontiguousarray(hits.uv[:, 0]),
            "v": np.ascontiguousarray(hits.uv[:, 1]),
        }
        for name, column in columns.items():
            batch = batch.append_column(name, arrow.array(column))
        return batch


def episodes(
    paths: Iterable[str | os.PathLike[str]], *, stream: str | None = None, layout: Layout | str | os.PathLike[str] | Mapping[str, Any] | None = None
) -> list[dict[str, Any]]:
    """A row for each episode of some recordings, for `ray.data.from_items`: nothing but headers is read.

    Parameters
    ----------
    paths : iterable of str or os.PathLike
        What `Readings.open` opens, as Zarrs of Open-X-Tactile and LeRobot datasets, where every worker finds it.
    stream, layout
        As in `Readings.open`.

    Returns
    -------
    list of dict
        `path`, made absolute, `episode`, and `file`, the name of the output without its extension: that of the recording and the number.

    Raises
    ------
    DataError, FileError
        If one of them is no recording that can be read, or two have one name.

    Examples
    --------
    >>> import dermatome, dermatome.ray
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> readings, truth = dermatome.touch(palm, presses=1)
    >>> readings.write("touch.npz")
    >>> [(episode["episode"], episode["file"]) for episode in dermatome.ray.episodes(["touch.npz"])]
    [(0, 'touch.000000')]
    """
    made: list[dict[str, Any]] = []
    known: dict[str, str] = {}
    for given in items_of("paths", paths, "a list of paths"):
        path = os.path.abspath(path_of("paths", given, "a list of paths"))
        name = Path(path).stem
        if known.setdefault(name, path) != path:
            raise DataError(f"paths: found {known[name]} and {path}; needed: recordings of different names")
        with Readings.open(path, stream=stream, layout=layout) as recording:
            # A stream whose end is not known is one episode.
            made += [{"path": path, "episode": k, "file": f"{name}.{k:06d}"} for k in range(max(1, len(recording.episodes)))]
    return made


class Render:
    """Images, or the values of fields, of episodes of recordings: for `Dataset.map` with an actor for each worker.

    Each row of `episodes` becomes a file in a folder, `NAME.npz` with `values` (T, C, H, W), or (T, C, fields), float32,
    `timestamps` (T,) in s, `channels` and `units`. A file is there once it is whole, and an episode that has one is not read
    again: a job that was stopped goes on where it was. A file of another map, level, renderer or recording is an error. A worker holds one episode, the driver a row of each: `file`,
    `frames`, and `error`, which says why an episode that cannot be read has no file.

    Parameters
    ----------
    map : str, os.PathLike or bytes
        A `map.glb` that every worker can read, or `Map.to_bytes()`.
    folder : str or os.PathLike
        Where files are written: a folder that all workers share.
    level : int or str
        The level that is drawn, or whose fields have values: without a renderer also one of `Map.field_levels`, as "body.L0".
    renderer : dict, optional
        Arguments of `Map.renderer` for images, as `{"size": (64, 96), "patch": "palm"}`; None: values of fields.
    stream, layout
        As in `Readings.open`.

    Raises
    ------
    MissingFileError, FileError
        If the map does not exist, or the folder cannot be written.
    DataError
        If the map has no such level, or an argument of the renderer cannot be used.
    """

    def __init__(
        self,
        map: str | os.PathLike[str] | bytes,
        folder: str | os.PathLike[str],
        level: int | str = 0,
        renderer: Mapping[str, Any] | None = None,
        *,
        stream: str | None = None,
        layout: Layout | str | os.PathLike[str] | Mapping[str, Any] | None = None,
    ) -> None:
        self.map = _map_of(map)
        self.folder, self.level = Path(path_of("folder", folder)), level
        self.options = None if renderer is None else _options_of(renderer)
        self._hash = _plain(self.map)
        # A file is read here: files of images follow from what it says, and not from its name.
        self._opening: dict[str, Any] = {"stream": stream, "layout": layout if isinstance(layout, str) and layout in ("tnc", "tcn") else layout_of(layout)}
        self._draw: dict[Any, Any] = {}
        self._recording: Any = None
        self._values(Readings.from_arrays([[0.0] * self.map.n_taxels]))  # What cannot be drawn is an error before any episode is read.
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"{folder}: cannot be written: {error}", "io") from error

    def __call__(self, row: dict[str, Any]) -> dict[str, Any]:
        np = need("numpy", "ray")
        file = self.folder / f"{row['file']}.npz"
        said = {"file": str(file), "frames": 0, "error": ""}
        if file.exists():
            try:
                with np.load(file) as made:
                    if os.path.exists(row["path"]) and str(made["made_by"]) != self._made_by(row):
                        needed = "another folder, or none of this name: remove it, and the episode is read again"
                        return said | {"error": f"{file}: found a file of another map, level, renderer or recording; needed: {needed}"}
                    return said | {"frames": len(made["timestamps"])}
            except Exception as error:  # Of a damaged file numpy raises what its parts do.
                return said | {"error": f"{file}: cannot be read: {error}; needed: a whole file, or none: remove it, and the episode is read again"}
        try:
            parts = list(self._episode(row))
        except Error as error:
            return said | {"error": str(error)}
        if not parts:
            return said | {"error": f"{row['path']}: found no frame in episode {row['episode']}; needed: one or more"}
        first = parts[0]
        arrays = {"values": np.concatenate([self._values(part) for part in parts]), "timestamps": np.concatenate([part.timestamps for part in parts])}
        # Another worker may write the same episode.
        with written(file) as part:
            about = {"channels": np.array(first.channels), "units": np.array(first.units), "made_by": np.array(self._made_by(row))}
            np.savez(part, **arrays, **about)
        return said | {"frames": len(arrays["timestamps"])}

    def _made_by(self, row: dict[str, Any]) -> str:
        """What a file follows from, as a number: map, level, renderer, how recordings are read, and the recording as it is."""
        about = os.stat(row["path"])
        of_row = row["path"], row["episode"], about.st_size, about.st_mtime_ns
        text = json.dumps((self._hash, self.level, self.options, self._opening, *of_row), default=_plain, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def _episode(self, row: dict[str, Any]) -> Any:
        """The chunks of an episode; the headers of a recording are read once for all that follow each other."""
        if self._recording is None or self._recording.path != row["path"]:
            self._recording = Readings.open(row["path"], **self._opening)
        self._recording.episode = int(row["episode"])
        return self._recording.chunks(self.map)

    def _values(self, part: Readings) -> Any:
        if self.options is None:
            return part.pooled(self.map, self.level)
        if isinstance(self.level, str):
            raise DataError(f"level: found {self.level!r} and a renderer; needed: the number of a level, or no renderer")
        kinds = part.extensive, part.modalities(self.map)
        if kinds not in self._draw:
            how: Any = {"channels": len(part.channels), "extensive": kinds[0], "modality": kinds[1]}
            self._draw[kinds] = self.map.renderer(self.level, **how, **self.options)
        return self._draw[kinds](part.values)


def touch_counts(batch: Any) -> Any:
    """Counts, sums and maxima of a batch of cells, which add up across batches and workers.

    Takes the table that `Lookup` returns, with a column `force` or not, and returns one row for each cell: `patch`,
    `field`, `count`, and of forces `force_sum` and `force_max`.

    Raises
    ------
    KeyError
        If the batch has no column `patch` or `field`.
    """
    grouped = batch.group_by(["patch", "field"])
    wanted = [("taxel_id", "count")]
    if "force" in batch.column_names:
        wanted += [("force", "sum"), ("force", "max")]
        compute, at = need("pyarrow.compute", "ray"), batch.column_names.index("force")
        # A force that is not known is none, also as NaN.
        force = batch.column("force").cast("float64")
        grouped = batch.set_column(at, "force", compute.if_else(compute.is_nan(force), None, force)).group_by(["patch", "field"])
    made = grouped.aggregate(wanted)
    return made.rename_columns(["count" if name == "taxel_id_count" else name for name in made.column_names])


def total(dataset: Any) -> Any:
    """The table of all cells of a dataset of `touch_counts`.

    Raises
    ------
    ImportError
        If ray is not installed.
    ray.exceptions.RayTaskError
        If a task failed.
    """
    arrow = need("pyarrow", "ray")
    parts = [part for part in dataset.iter_batches(batch_format="pyarrow", batch_size=None) if len(part)]
    if not parts:
        return arrow.table({})
    table = arrow.concat_tables(parts, promote_options="default")
    wanted = [("count", "sum")]
    if "force_sum" in table.column_names:
        wanted += [("force_sum", "sum"), ("force_max", "max")]
    made = table.group_by(["patch", "field"]).aggregate(wanted)
    names = {"count_sum": "count", "force_sum_sum": "force_sum", "force_max_max": "force_max"}
    return made.rename_columns([names.get(name, name) for name in made.column_names]).sort_by(
        [("patch", "ascending"), ("field", "ascending")]
    )
