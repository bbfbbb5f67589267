"""Levels of a map as meshes of trimesh, and skins from them."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import level_of, need
from dermatome._arguments import flag_of
from dermatome._dermatome import Map, Skin

__all__ = ["mesh", "skin"]


# A skin of a `trimesh.Trimesh`, in m.
skin = Skin.from_mesh


def mesh(map: Map, *, patch: str | None = None, level: int = 0, flat: bool = False) -> Any:
    """A level of a patch as a `trimesh.Trimesh`, with its map as texture coordinates.

    Where the map is cut, vertices of the seam are there once for each of their places; `mesh.metadata["vertex"]` is
    the vertex of the level that each one is.

    Parameters
    ----------
    flat : bool
        Whether its vertices are the places on the map, in m, and not those of the skin.

    Raises
    ------
    ImportError
        If trimesh is not installed.
    DataError
        If the map has no such patch or level.
    """
    trimesh, np = need("trimesh", "trimesh"), need("numpy", "trimesh")
    of, flat = level_of(map, patch, level), flag_of("flat", flat)
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
