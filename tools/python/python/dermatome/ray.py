"""Contacts and recordings on a cluster: batches of Ray Data."""

from __future__ import annotations

import os
from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Index, Map

__all__ = ["Lookup", "total", "touch_counts"]


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
    """

    def __init__(self, map: str | os.PathLike[str] | bytes, level: int = 0, threads: int = 1) -> None:
        read = Map.from_bytes(map) if isinstance(map, bytes) else Map.read(map)
        self.level, self.threads = level, threads
        self.index: Index = read.index(threads=threads)

    def __call__(self, batch: Any) -> Any:
        np, arrow = need("numpy", "ray"), need("pyarrow", "ray")
        points = np.column_stack([batch[name].to_numpy() for name in ("x", "y", "z")])
        hits = self.index.locate(points, level=self.level, threads=self.threads)
        assert hits.uv is not None
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


def touch_counts(batch: Any) -> Any:
    """Counts, sums and maxima of a batch of cells, which add up across batches and workers.

    Takes the table that `Lookup` returns, with a column `force` or not, and returns one row for each cell: `patch`,
    `field`, `count`, and of forces `force_sum` and `force_max`.
    """
    grouped = batch.group_by(["patch", "field"])
    wanted = [("taxel_id", "count")]
    if "force" in batch.column_names:
        wanted += [("force", "sum"), ("force", "max")]
    made = grouped.aggregate(wanted)
    return made.rename_columns(["count" if name == "taxel_id_count" else name for name in made.column_names])


def total(dataset: Any) -> Any:
    """The table of all cells of a dataset of `touch_counts`."""
    arrow = need("pyarrow", "ray")
    parts = [part for part in dataset.iter_batches(batch_format="pyarrow", batch_size=None) if len(part)]
    if not parts:
        return arrow.table({})
    table = arrow.concat_tables(parts)
    wanted = [("count", "sum")]
    if "force_sum" in table.column_names:
        wanted += [("force_sum", "sum"), ("force_max", "max")]
    made = table.group_by(["patch", "field"]).aggregate(wanted)
    names = {"count_sum": "count", "force_sum_sum": "force_sum", "force_max_max": "force_max"}
    return made.rename_columns([names.get(name, name) for name in made.column_names]).sort_by(
        [("patch", "ascending"), ("field", "ascending")]
    )
