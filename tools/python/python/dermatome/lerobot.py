"""Features of a LeRobot dataset: finite vectors of one axis, each with the mask of its frame beside it."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import field_counts, need, patches_of
from dermatome._arguments import A_MAP, check_kind, mapping_of, number_of
from dermatome._dermatome import Map, Renderer, as_floats
from dermatome._errors import DataError

__all__ = ["features", "frame", "keys", "masks"]

PREFIX = "observation.tactile"


def key(patch: str, level: int | str) -> str:
    """The name of a feature: no slash, as LeRobot wants it; of a level without a mesh, as "body.L0", the name of that level.

    Raises
    ------
    DataError
        If the level is no whole number from 0 on.
    """
    name = level if isinstance(level, str) else f"{patch}.L{level}"
    return f"{PREFIX}.{name.replace('/', '_')}"


def keys(map: Map, level: int | str) -> dict[str, str]:
    """The feature of each patch: `key`, with a number where two patches would have the same one. Of a level without a mesh there is one
    feature, which has the name of the level. Next to levels of the whole body a patch called `body` is `%62ody`.

    Raises
    ------
    DataError
        If the map has no such level.
    """
    if isinstance(level, str):
        return {name: key(name, level) for name, _, _ in field_counts(map, level)}
    taken: dict[str, str] = {}
    for name in patches_of(map):
        plain = map._name_in_levels(name)
        free, number = plain, 1
        while key(free, level) in taken:
            number += 1
            free = f"{plain}_{number}"
        taken[key(free, level)] = name
    return {name: feature for feature, name in taken.items()}


def features(map: Map, level: int | str = 1, *, images: dict[str, Renderer] | None = None) -> dict[str, dict[str, Any]]:
    """The features of every patch, for `LeRobotDataset.create`.

    Each `observation.tactile.PATCH.LEVEL` has a feature `....valid` next to it, which is 1 where the value of a frame is
    known and 0 where it is not.

    Parameters
    ----------
    level : int
        The level whose values are kept; a patch without it has those of its coarsest level.
    images : dict of str to Renderer, optional
        Renderers by the names of the images (`observation.images.NAME`), which are kept as 8-bit pictures.

    Raises
    ------
    DataError
        If the map has no such level, or images are not height and width.
    """
    made: dict[str, dict[str, Any]] = {}
    names = keys(map, level)
    for name, count, _ in field_counts(map, level):
        for feature in (names[name], f"{names[name]}.valid"):
            made[feature] = {"dtype": "float32", "shape": (count,), "names": None}
    for name, renderer in _renderers_of(images).items():
        shape = (*renderer.shape, 3)
        made[f"observation.images.{name}"] = {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}
    return made


def _renderers_of(images: Any) -> dict[str, Renderer]:
    """Renderers by the names of images."""
    needed = "a dict of names of images to renderers, as Map.renderer makes them"
    given = mapping_of("images", {} if images is None else images, needed)
    for name, renderer in given.items():
        check_kind(f"images[{name!r}]", renderer, Renderer, needed)
    return dict(given)


def frame(
    map: Map,
    values: Any,
    level: int | str = 1,
    *,
    extensive: bool = False,
    modality: str | None = None,
    images: dict[str, Renderer] | None = None,
    limit: float | None = None,
) -> dict[str, Any]:
    """The values of these features for one frame of readings (N,); what is not known is 0, and its `valid` is 0.

    Parameters
    ----------
    extensive : bool
        Whether readings are amounts, as forces: their total is the same on every level.
    modality : str, optional
        Of which modality besides touch they are, as "thermal" (`Readings.modalities` says so).
    limit : float, optional
        The value that is white in the pictures, in the unit in which the renderers draw: that of the readings (1 by
        default), or for renderers of amounts that per m^2 of the map, which has no default.

    Raises
    ------
    DataError
        If the shape is another, the map has no such level, or the limit is no number above 0.
    """
    np = need("numpy", "lerobot")
    check_kind("map", map, Map, A_MAP)
    renderers = _renderers_of(images)
    if limit is None and any(any(renderer.extensive) for renderer in renderers.values()):
        raise DataError("limit: found none for a renderer of amounts; needed: the value per m^2 of the map that is white")
    white = 1.0 if limit is None else number_of("limit", limit, "a number above 0")
    if not 0 < white < float("inf"):
        raise DataError(f"limit: found {limit}; needed: a number above 0")
    values = as_floats("values", values)
    if values.shape != (map.n_taxels,):
        raise DataError(f"values: found shape {values.shape}; needed: ({map.n_taxels},), one frame of one channel")
    pooled = map.pool(values, level, extensive=extensive, modality=modality)
    known = np.isfinite(pooled)
    finite, valid = np.where(known, pooled, np.float32(0)), known.astype(np.float32)
    made: dict[str, Any] = {}
    names = keys(map, level)
    for name, _, fields in field_counts(map, level):
        made[names[name]] = finite[fields].copy()
        made[f"{names[name]}.valid"] = valid[fields].copy()
    for name, renderer in renderers.items():
        grey = np.clip(np.nan_to_num(renderer(values[None])[0, 0]) / white * 255, 0, 255).astype(np.uint8)
        made[f"observation.images.{name}"] = np.repeat(grey[:, :, None], 3, axis=2)
    return made


def masks(map: Map, level: int | str = 1, *, modality: str | None = None) -> dict[str, Any]:
    """Which values of each feature are ever known: (n,) bool arrays, the same in every frame, of touch or another modality.

    Raises
    ------
    DataError
        If the map has no such level.
    """
    np = need("numpy", "lerobot")
    check_kind("map", map, Map, A_MAP)
    known, names = np.isfinite(map.pool(np.zeros(map.n_taxels), level, modality=modality)), keys(map, level)
    return {names[name]: known[fields].copy() for name, _, fields in field_counts(map, level)}
