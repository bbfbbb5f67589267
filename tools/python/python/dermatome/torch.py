"""Pooling and drawing as sparse tensors and modules, and recordings as data sets: differentiable, on any device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dermatome._adapter import need
from dermatome._arguments import check_kind, flag_of
from dermatome._dermatome import Map, Matrix, Renderer
from dermatome._weights import shares

if TYPE_CHECKING:
    from dermatome._torch_augment import Augment
    from dermatome._torch import Draw, Pool, Touches

__all__ = ["Augment", "Draw", "Pool", "Touches", "pixels", "pooling", "tensor"]


def __getattr__(name: str) -> Any:
    # The classes inherit from those of torch, which is imported when one of them is asked for.
    if name in ("Augment", "Draw", "Pool", "Touches"):
        need("torch", "torch")
        from dermatome import _torch

        return getattr(_torch, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def tensor(matrix: Matrix, *, device: Any = None, dtype: Any = None) -> Any:
    """A `Matrix` as a sparse COO tensor, 32-bit unless another `dtype` is given.

    Raises
    ------
    DataError
        If it is no `Matrix`.
    """
    np = need("numpy", "torch")
    check_kind("matrix", matrix, Matrix, "a Matrix, as Map.pooling makes it")
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return _sparse(rows, matrix.indices, matrix.data, matrix.shape, device, dtype)


def pooling(
    map: Map,
    level: int | str,
    *,
    patch: str | None = None,
    extensive: bool = False,
    modality: str | None = None,
    device: Any = None,
    dtype: Any = None,
) -> Any:
    """The pooling of values where no reading is missing: (fields, taxels), sparse COO.

    `pooling(map, 2) @ values.T` is what `Map.pool` gives for values without NaN, but 0 where that is NaN. Columns of
    taxels that are not present are empty. `Pool` takes NaN as well.

    Parameters
    ----------
    extensive : bool
        Whether values are amounts, as forces: columns have the sum 1. By default they are averages: rows have the sum 1.
    modality : str, optional
        Of which modality besides touch they are, as "thermal": columns of other taxels are empty.

    Raises
    ------
    DataError
        If the map has no such level or patch.
    """
    taxel, field, weight, shape = shares(map, level, patch, flag_of("extensive", extensive), modality)
    if not extensive:
        np = need("numpy", "torch")
        weight = weight / np.bincount(field, weights=weight, minlength=shape[0])[field]
    return _sparse(field, taxel, weight, shape, device, dtype)


def pixels(renderer: Renderer, *, channel: int = 0, device: Any = None, dtype: Any = None) -> Any:
    """The matrix that draws values of a level where no reading is missing: (H W, values), sparse COO.

    That of `Renderer.matrix`: amounts are drawn per m^2, and taxels that are not present have no part. `Draw` takes NaN for
    any value.

    Raises
    ------
    DataError
        If there is no such channel.
    """
    check_kind("renderer", renderer, Renderer, "a Renderer, as Map.renderer makes it")
    return tensor(renderer.matrix(channel), device=device, dtype=dtype)


def _sparse(rows: Any, columns: Any, values: Any, shape: tuple[int, int], device: Any, dtype: Any) -> Any:
    torch, np = need("torch", "torch"), need("numpy", "torch")
    places = torch.from_numpy(np.stack([rows, columns]).astype(np.int64))
    data = torch.from_numpy(values).to(dtype or torch.float32)
    # Named, since torch warns where it is left to it.
    return torch.sparse_coo_tensor(places, data, shape, device=device, check_invariants=False).coalesce()
