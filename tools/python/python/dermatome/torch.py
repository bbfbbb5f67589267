"""Pooling and pixel matrices as sparse tensors: differentiable, on any device."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Map, Matrix, Renderer


def tensor(matrix: Matrix, *, device: Any = None, dtype: Any = None) -> Any:
    """A `Matrix` as a sparse CSR tensor, 32-bit unless another `dtype` is given."""
    torch = need("torch", "torch")
    return torch.sparse_csr_tensor(
        torch.from_numpy(matrix.indptr),
        torch.from_numpy(matrix.indices),
        torch.from_numpy(matrix.data).to(dtype or torch.float32),
        size=matrix.shape,
        device=device,
    )


def pooling(map: Map, level: int, *, patch: str | None = None, device: Any = None, dtype: Any = None) -> Any:
    """The pooling of pressures where no reading is missing: (fields, taxels), rows with sum 1.

    `pooling(map, 2) @ values.T` is what `Map.pool` gives for values without NaN.
    """
    torch, np = need("torch", "torch"), need("numpy", "torch")
    direct = map.pooling(level, patch=patch)
    taxels, fields = direct.shape
    of = [map.patches[patch]] if patch is not None else map.patches.values()
    areas = np.concatenate([each.levels[0].areas for each in of])
    taxel = np.repeat(np.arange(taxels), np.diff(direct.indptr))
    shares = direct.data * areas[taxel]
    shares /= np.bincount(direct.indices, weights=shares, minlength=fields)[direct.indices]
    places = torch.from_numpy(np.stack([direct.indices, taxel]))
    values = torch.from_numpy(shares).to(dtype or torch.float32)
    return torch.sparse_coo_tensor(places, values, (fields, taxels), device=device).coalesce().to_sparse_csr()


def pixels(renderer: Renderer, *, device: Any = None, dtype: Any = None) -> Any:
    """The matrix that draws values of a level: (H W, values)."""
    return tensor(renderer.matrix(), device=device, dtype=dtype)
