"""Touch sensors of MuJoCo at the taxels or receptive fields of a map."""

from __future__ import annotations

from typing import Any

from dermatome._adapter import level_of, need, patch_of
from dermatome._dermatome import Map
from dermatome._errors import DataError


def attach(
    spec: Any,
    map: Map,
    *,
    body: str | None = None,
    patch: str | None = None,
    level: int = 0,
    name: str | None = None,
) -> str:
    """Add a tactile sensor at the vertices of a level to a `mujoco.MjSpec`.

    The skin is a geom without mass that takes part in no collision: it feels what the solver reports in contact with
    another geom of the same body.

    Parameters
    ----------
    spec : mujoco.MjSpec
        The model.
    map : Map
        The map.
    body : str, optional
        The body whose frame is that of the patch's link; by default the one of the link's name.
    patch : str, optional
        The patch; by default the only one.
    level : int
        The level.
    name : str, optional
        Name of the sensor; by default that of the patch.

    Returns
    -------
    str
        The name of the sensor.
    """
    mujoco = need("mujoco", "mujoco")
    of, whole = level_of(map, patch, level), patch_of(map, patch)
    name = name or whole.name
    target = spec.body(body or whole.link)
    if target is None:
        raise DataError(f"body: found {body or whole.link!r}; needed: a body of the model")
    tangents = of.tangents
    if tangents is None:
        raise DataError("map: found no tangents; needed: a map with tangents")
    np = need("numpy", "mujoco")
    # MuJoCo takes for each vertex its normal, its tangent and their product.
    frames = np.concatenate([of.normals, tangents, np.cross(of.normals, tangents)], axis=1)
    spec.add_mesh(
        name=name,
        uservert=of.positions.ravel().tolist(),
        userface=of.faces.astype(np.int32).ravel().tolist(),
        usernormal=frames.ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    target.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0, contype=0, conaffinity=0, group=3
    )
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_TACTILE,
        objtype=mujoco.mjtObj.mjOBJ_MESH,
        objname=name,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname=name,
    )
    return name


def readings(data: Any, name: str) -> Any:
    """What a sensor feels: (3, n) array of the depth (m) and the slip along tangent and binormal (m/s).

    Parameters
    ----------
    data : mujoco.MjData
        The state.
    name : str
        The name that `attach` returned.
    """
    return data.sensor(name).data.reshape(3, -1).copy()
