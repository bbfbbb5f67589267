"""Maps and readings in Rerun: the skin with a colour for each taxel."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import fields_of, need
from dermatome._arguments import READINGS, check_kind, number_of, word_of
from dermatome._dermatome import Map
from dermatome._readings import Readings, channel_of

__all__ = ["log"]


def log(
    map: Map, readings: Readings | None = None, *, level: int = 0, entity: str = "skin", channel: int | None = None, limit: float | None = None
) -> None:
    """Log every patch of a map where its link is, and one channel of a recording on it.

    Parameters
    ----------
    level : int
        The level; a patch without it is logged on its coarsest level.
    readings : Readings, optional
        The recording, in the order of the map or with ids.
    channel : int, optional
        The channel that is shown; by default the first that measures touches.
    limit : float, optional
        What is brightest, in the unit of the readings; by default the largest value that is shown.

    Raises
    ------
    ImportError
        If rerun is not installed.
    DataError
        If readings are not of the map, or there is no such level or channel.
    """
    rerun, np = need("rerun", "rerun"), need("numpy", "rerun")
    entity = word_of("entity", entity)
    fields, poses = fields_of(map, level), map.index().poses
    for name, of, _ in fields:
        pose = poses[map.patches[name].link]
        rerun.log(
            f"{entity}/{name}",
            rerun.Mesh3D(vertex_positions=of.positions, triangle_indices=of.faces, vertex_normals=of.normals),
            rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]),
            static=True,
        )
    if readings is None:
        return
    check_kind("readings", readings, Readings, READINGS)
    readings = readings.on(map)
    channel = channel_of(readings, channel)
    how: Any = {"extensive": readings.extensive[channel], "modality": readings.modalities(map)[channel]}
    values = map.pool(readings.values[:, channel], level, **how)
    top = (0.0 if limit is None else number_of("limit", limit, "a number above 0")) or float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
    for frame, row in enumerate(values):
        if np.isfinite(readings.timestamps[frame]):
            rerun.set_time("time", duration=float(readings.timestamps[frame]))
        rerun.set_time("frame", sequence=frame)
        for name, _, part in fields:
            share = np.clip(np.nan_to_num(row[part]) / top, 0, 1)[:, None]
            colours = (255 * (share * [1.0, 0.9, 0.1] + (1 - share) * [0.2, 0.1, 0.4])).astype(np.uint8)
            rerun.log(f"{entity}/{name}", rerun.Mesh3D.from_fields(vertex_colors=colours))
        rerun.log(f"{entity}/total", rerun.Scalars(float(np.nansum(row))))
