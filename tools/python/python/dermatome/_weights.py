"""The weights of pools and images, for `dermatome.torch`."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import checked, need, patch_of, patches_of
from dermatome._dermatome import Map, Renderer

# Weights that are rounded away in 32 bits.
LEAST = 1e-18


def shares(
    map: Map, level: int | str, patch: str | None, extensive: bool, modality: str | None = None
) -> tuple[Any, Any, Any, tuple[int, int]]:
    """Taxel, field and weight of every share that a taxel with readings has in a field, and the numbers of both.

    Averages are weighted by areas (m^2).
    """
    np = need("numpy", "torch")
    of = list(patches_of(map).values()) if patch is None else [patch_of(map, patch)]
    direct = map.pooling(level if isinstance(level, str) else checked(map, level), patch=patch)
    taxels, fields = direct.shape
    is_read = map._read(modality)[of[0].start : of[0].start + taxels]
    taxel = np.repeat(np.arange(taxels), np.diff(direct.indptr))
    kept = is_read[taxel] & (direct.data != 0)
    taxel, weight = taxel[kept], direct.data[kept]
    if not extensive:
        weight = weight * np.concatenate([each.levels[0].areas for each in of])[taxel]
    return taxel, direct.indices[kept], weight, (fields, taxels)


def marks(renderer: Renderer) -> tuple[Any, Any, Any, tuple[int, int], Any]:
    """Pixel, value and weight of every value that a pixel shows, the numbers of both, and the pixel that gets the amount of
    each value that no pixel shows, -1 for none."""
    np = need("numpy", "torch")
    matrix, nearest = renderer._marks()
    pixel = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    # A pixel on a corner without a value shows the mean of the other two, which have no weight there.
    return pixel, matrix.indices, np.maximum(matrix.data, LEAST), matrix.shape, nearest
