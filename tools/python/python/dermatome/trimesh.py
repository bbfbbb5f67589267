"""Levels of a map as meshes of trimesh, and skins from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from dermatome._adapter import level_of, need
from dermatome._dermatome import Map, Skin
from dermatome._errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = ["mesh", "skin"]


def skin(
    mesh: Any,
    *,
    normals: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    present: ArrayLike | None = None,
    link: str | Sequence[str] | None = None,
    patch: str | Sequence[str] | None = None,
    gap: float = 2.5,
    weld: Literal["auto", "all", "none", "texture"] = "auto",
    repair: bool = False,
    outside: ArrayLike | None = None,
    fill_holes: int | None = None,
) -> Skin:
    """A skin of a `trimesh.Trimesh`, in m; the options are those of `Skin.from_arrays`."""
    return Skin.from_mesh(
        mesh,
        normals=normals,
        ids=ids,
        present=present,
        link=link,
        patch=patch,
        gap=gap,
        weld=weld,
        repair=repair,
        outside=outside,
        fill_holes=fill_holes,
    )


def mesh(map: Map, *, patch: str | None = None, level: int = 0, flat: bool = False) -> Any:
    """A level of a patch as a `trimesh.Trimesh`, with its map as texture coordinates.

    Where the map is cut, vertices of the seam are there once for each of their places; `mesh.metadata["vertex"]` is
    the vertex of the level that each one is.

    Parameters
    ----------
    flat : bool
        Whether its vertices are the places on the map, in m, and not those of the skin.
    """
    trimesh, np = need("trimesh", "trimesh"), need("numpy", "trimesh")
    of = level_of(map, patch, level)
    vertex = of.vertex_of_place
    places = np.column_stack([of.uv, np.zeros(len(of.uv))]) if flat else of.positions[vertex]
    made = trimesh.Trimesh(
        places,
        of.uv_faces,
        vertex_normals=None if flat else of.normals[vertex],
        process=False,
        metadata={"vertex": vertex, "taxel_id": of.taxel_ids[vertex]},
    )
    corner, size = (of.frame.x, of.frame.y), (of.frame.width, of.frame.height)
    made.visual = trimesh.visual.TextureVisuals(
        uv=(of.uv - corner) / size, material=trimesh.visual.material.PBRMaterial(metallicFactor=0.0)
    )
    return made
