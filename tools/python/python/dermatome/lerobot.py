"""Features of a LeRobot dataset: finite vectors of one axis, with a mask beside them that does not change."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Map, Renderer

PREFIX = "observation.tactile"


def key(patch: str, level: int) -> str:
    """The name of a feature: no slash, as LeRobot wants it."""
    return f"{PREFIX}.{patch.replace('/', '_')}.L{level}"


def features(map: Map, level: int = 1, *, images: dict[str, Renderer] | None = None) -> dict[str, dict[str, Any]]:
    """The features of every patch, for `LeRobotDataset.create`.

    Parameters
    ----------
    level : int
        The level whose values are kept.
    images : dict of str to Renderer, optional
        Renderers by the names of the images (`observation.images.NAME`), which are kept as 8-bit pictures.
    """
    made: dict[str, dict[str, Any]] = {}
    for name, patch in map.patches.items():
        if level < len(patch.levels):
            count = len(patch.levels[level].positions)
            made[key(name, level)] = {"dtype": "float32", "shape": (count,), "names": None}
    for name, renderer in (images or {}).items():
        shape = (*renderer.shape, 3)
        made[f"observation.images.{name}"] = {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}
    return made


def frame(
    map: Map,
    values: Any,
    level: int = 1,
    *,
    extensive: bool = False,
    images: dict[str, Renderer] | None = None,
    limit: float = 1.0,
) -> dict[str, Any]:
    """The values of these features for one frame of readings (N,); what is not known is 0.

    Parameters
    ----------
    limit : float
        The reading that is white in the pictures.
    """
    np = need("numpy", "lerobot")
    values = np.asarray(values, dtype=np.float64)
    pooled = np.nan_to_num(map.pool(values, level, extensive=extensive)).astype(np.float32)
    made, first = {}, 0
    for name, patch in map.patches.items():
        if level < len(patch.levels):
            count = len(patch.levels[level].positions)
            made[key(name, level)] = pooled[first : first + count].copy()
            first += count
    for name, renderer in (images or {}).items():
        grey = np.clip(np.nan_to_num(renderer(values[None])[0, 0]) / limit * 255, 0, 255).astype(np.uint8)
        made[f"observation.images.{name}"] = np.repeat(grey[:, :, None], 3, axis=2)
    return made


def masks(map: Map, level: int = 1) -> dict[str, Any]:
    """Which values of each feature are ever known: (n,) bool arrays, the same in every frame."""
    np = need("numpy", "lerobot")
    known = np.isfinite(map.pool(np.zeros(map.n_taxels), level))
    made, first = {}, 0
    for name, patch in map.patches.items():
        if level < len(patch.levels):
            count = len(patch.levels[level].positions)
            made[key(name, level)] = known[first : first + count].copy()
            first += count
    return made
