"""Pooling and drawing as sparse tensors and modules, and recordings as data sets: differentiable, on any device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dermatome._adapter import need
from dermatome._dermatome import Map, Matrix, Renderer
from dermatome._errors import DataError
from dermatome._weights import marks, shares

if TYPE_CHECKING:
    from dermatome._torch import Draw, Pool, Touches

__all__ = ["Draw", "Pool", "Touches", "pixels", "pooling", "tensor"]


def __getattr__(name: str) -> Any:
    # The classes inherit from those of torch, which is imported when one of them is asked for.
    if name in ("Draw", "Pool", "Touches"):
        need("torch", "torch")
        from dermatome import _torch

        return getattr(_torch, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def tensor(matrix: Matrix, *, device: Any = None, dtype: Any = None) -> Any:
    """A `Matrix` as a sparse COO tensor, 32-bit unless another `dtype` is given."""
    np = need("numpy", "torch")
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return _sparse(rows, matrix.indices, matrix.data, matrix.shape, device, dtype)


def pooling(
    map: Map, level: int, *, patch: str | None = None, extensive: bool = False, device: Any = None, dtype: Any = None
) -> Any:
    """The pooling of values where no reading is missing: (fields, taxels), sparse COO.

    `pooling(map, 2) @ values.T` is what `Map.pool` gives for values without NaN, but 0 where that is NaN. Columns of
    taxels that are not present are empty. `Pool` takes NaN as well.

    Parameters
    ----------
    extensive : bool
        Whether values are amounts, as forces: columns have the sum 1. By default they are averages: rows have the sum 1.
    """
    taxel, field, weight, shape = shares(map, level, patch, extensive)
    if not extensive:
        np = need("numpy", "torch")
        weight = weight / np.bincount(field, weights=weight, minlength=shape[0])[field]
    return _sparse(field, taxel, weight, shape, device, dtype)


def pixels(renderer: Renderer, *, map: Map | None = None, device: Any = None, dtype: Any = None) -> Any:
    """The matrix that draws values of a level, which are averages: (H W, values), sparse COO.

    A renderer of level 0 with one channel leaves out taxels that are not present, as its images do. `Draw` takes NaN for
    any value.

    Parameters
    ----------
    map : Map, optional
        The map, where the renderer has several channels and the map has taxels that are not present.
    """
    np = need("numpy", "torch")
    pixel, value, weight, shape = marks(renderer)
    if map is not None and map.n_taxels == shape[1]:
        weight = np.where(map.present[value] == 1, weight, 0.0)
    elif map is None:
        value, weight = _probed(renderer, pixel, value, weight, shape)
    total = np.bincount(pixel, weights=weight, minlength=shape[0])[pixel]
    kept = (weight != 0) & (total > 0)
    return _sparse(pixel[kept], value[kept], (weight[kept] / total[kept]), shape, device, dtype)


def _probed(renderer: Renderer, pixel: Any, value: Any, weight: Any, shape: tuple[int, int]) -> tuple[Any, Any]:
    """The values that have a part in what is drawn, and their weights: those of taxels that are not present are 0."""
    np = need("numpy", "torch")
    frames: Any = np.random.default_rng(0).random((3, shape[1])).astype(np.float32)
    frames = np.concatenate([frames, np.arange(shape[1], dtype=np.float32)[None]])
    try:
        drawn: Any = renderer(frames)[:, 0].reshape(len(frames), -1)
    except DataError:
        return value, weight  # A coarser level, or several channels.
    if len(np.unique(pixel)) == len(pixel) and shape[1] <= 1 << 24:  # Each pixel shows the nearest value that is there.
        nearest = drawn[-1][pixel]
        return np.nan_to_num(nearest).astype(np.int64), np.where(np.isfinite(nearest), weight, 0.0)
    frames, drawn = frames[:-1], drawn[:-1]
    first = np.searchsorted(pixel, np.arange(shape[0]))
    rank = np.arange(len(pixel)) - first[pixel]
    # A pixel shows at most three values: the set of them that draws what was drawn is that of the taxels present.
    best, kept = np.full(shape[0], np.inf), np.full(shape[0], 0)
    for chosen in (7, 6, 5, 3, 4, 2, 1):
        part = np.where(chosen >> rank & 1, weight, 0.0)
        total = np.bincount(pixel, weights=part, minlength=shape[0])
        sums = np.stack([np.bincount(pixel, weights=part * frame[value], minlength=shape[0]) for frame in frames])
        with np.errstate(all="ignore"):
            error = np.abs(sums / total - drawn).max(axis=0)
        better = error < best - 1e-6
        best[better], kept[better] = error[better], chosen
    return value, np.where(kept[pixel] >> rank & 1, weight, 0.0)


def _sparse(rows: Any, columns: Any, values: Any, shape: tuple[int, int], device: Any, dtype: Any) -> Any:
    torch, np = need("torch", "torch"), need("numpy", "torch")
    places = torch.from_numpy(np.stack([rows, columns]).astype(np.int64))
    data = torch.from_numpy(values).to(dtype or torch.float32)
    # Named, since torch warns where it is left to it.
    return torch.sparse_coo_tensor(places, data, shape, device=device, check_invariants=False).coalesce()
