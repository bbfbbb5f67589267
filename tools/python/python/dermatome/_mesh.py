"""Vertices and triangles of the meshes of other packages."""

from __future__ import annotations

from typing import Any

from dermatome._errors import DataError

NEEDED = "a mesh with vertices and faces or triangles (trimesh, open3d, potpourri3d), or with points and faces or cells (pyvista, meshio)"


def arrays_of(mesh: Any) -> tuple[Any, Any]:
    """Positions (n, 3) and triangles (m, 3) of a mesh; polygons of four corners are two triangles."""
    import numpy as np

    kind = type(mesh).__name__
    if hasattr(mesh, "geometry") and hasattr(mesh, "to_mesh"):
        raise DataError(f"mesh: found a {kind} of several meshes; needed: one; scene.to_mesh() joins them")
    positions = _first(mesh, "vertices", "points")
    if positions is None and "positions" in (vertex := getattr(mesh, "vertex", {})):  # open3d.t
        return vertex["positions"].numpy(), mesh.triangle["indices"].numpy()
    if positions is None:
        raise DataError(f"mesh: found {kind}; needed: {NEEDED}")
    if hasattr(mesh, "cells_dict"):
        cells = {name: np.asarray(of) for name, of in mesh.cells_dict.items()}
        parts = [*_split(cells.pop("triangle", None)), *_split(cells.pop("quad", None))]
        if not parts:
            raise DataError(f"mesh: found cells {sorted(cells)}; needed: triangle or quad")
        return np.asarray(positions), np.concatenate(parts)
    faces: Any = _first(mesh, "faces", "triangles")  # `triangles` of trimesh are corners in space.
    if faces is None:
        return np.asarray(positions), None
    faces = np.asarray(faces)
    if faces.ndim == 1 and len(faces) > 0:  # pyvista: the number of corners before each face.
        corners = int(faces[0])
        if corners not in (3, 4) or len(faces) % (corners + 1) or (faces[:: corners + 1] != corners).any():
            raise DataError("mesh: found faces of several numbers of corners; needed: triangles; mesh.triangulate() makes them")
        faces = faces.reshape(-1, corners + 1)[:, 1:]
    return np.asarray(positions), np.concatenate(_split(faces)) if faces.ndim == 2 and faces.shape[1] == 4 else faces


def _first(mesh: Any, *names: str) -> Any:
    return next((getattr(mesh, name) for name in names if getattr(mesh, name, None) is not None), None)


def _split(faces: Any) -> list[Any]:
    """Triangles of faces of three or four corners."""
    if faces is None or len(faces) == 0:
        return []
    return [faces] if faces.shape[1] == 3 else [faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]
