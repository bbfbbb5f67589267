"""Probes of the tactile sensors of Genesis, at the fields of a map or on a regular grid of it."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import level_of, need, patch_of
from dermatome._arguments import flag_of, items_of, number_of, whole_of
from dermatome._dermatome import Map
from dermatome._errors import DataError

__all__ = ["probes"]


def probes(
    map: Map,
    *,
    patch: str | None = None,
    level: int = 0,
    grid: tuple[int, int] | None = None,
    radius: float | None = None,
    normals: bool = False,
) -> dict[str, Any]:
    """The options `probe_local_pos` and `probe_radius` of a sensor, in the frame of the link, as in
    `gs.sensors.ContactProbe(entity_idx=0, **probes(skin_map))`.

    Parameters
    ----------
    level : int
        The level; a patch without it has its coarsest level.
    grid : tuple of int, optional
        Rows and columns of a regular grid over the map, the first row on top, for `ContactProbe` and `KinematicTaxel`:
        probes outside of the map have radius 0, which those take for no probe. By default the vertices of the level.
    radius : float, optional
        Radius of a probe, in m; by default that of a disc of the mean area of a vertex.
    normals : bool
        Whether `probe_local_normal` is there too, which `ElastomerTaxel` and `ProximityTaxel` take, and others refuse.

    Raises
    ------
    DataError
        If the map has no such patch or level, or the grid is no pair of numbers above 0.
    """
    np = need("numpy", "genesis")
    points: Any
    outward: Any
    of, whole = level_of(map, patch, level), patch_of(map, patch)
    size = float(np.sqrt(of.areas.mean() / np.pi)) if radius is None else number_of("radius", radius, "a length in m")
    if grid is None:
        points, outward, radii = of.positions, of.normals, np.full(len(of.positions), size)
    else:
        needed = "two whole numbers above 0, rows and columns"
        pair = [whole_of("grid", each, needed) for each in items_of("grid", grid, needed)]
        if len(pair) != 2 or min(pair) < 1:
            raise DataError(f"grid: found {pair}; needed: {needed}")
        rows, columns = pair
        u = of.frame.x + (np.arange(columns) + 0.5) / columns * of.frame.width
        v = of.frame.y + (1 - (np.arange(rows) + 0.5) / rows) * of.frame.height
        places = np.stack(np.meshgrid(u, v), axis=-1)
        points, outward, off = map.to_skin(whole.name, places.reshape(-1, 2), level=of.number)
        points, outward = points.reshape(rows, columns, 3), outward.reshape(rows, columns, 3)
        radii = np.where(off > 0, 0.0, size).reshape(rows, columns)
    options = {"probe_local_pos": points, "probe_radius": radii}
    return {**options, "probe_local_normal": outward} if flag_of("normals", normals) else options
