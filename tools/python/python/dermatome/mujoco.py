"""Touch sensors of MuJoCo at the taxels or receptive fields of a map, and skins of its models."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import quoteattr

from dermatome._adapter import fields_of, level_of, need, patch_of
from dermatome._arguments import A_MAP, check_kind, flag_of, mapping_of, path_of, word_of, words_of
from dermatome._dermatome import Map, Skin
from dermatome._errors import DataError

__all__ = ["attach", "attach_all", "readings", "skin"]

A_SPEC = "a mujoco.MjSpec, as MjSpec.from_file reads it: sensors are added before it is compiled"
# Fewer vertices make no mesh of MuJoCo.
LEAST_VERTICES = 4


def attach(
    spec: Any,
    map: Map,
    *,
    body: str | None = None,
    patch: str | None = None,
    level: int = 0,
    name: str | None = None,
) -> str:
    """Add a tactile sensor at the vertices of a level of a patch to a `mujoco.MjSpec`.

    The skin is a geom without mass that takes part in no collision: it feels what the solver reports in contact with
    another geom of the same body, and only at its vertices: a contact between them that is less deep than they are apart is
    not felt.

    Parameters
    ----------
    spec : mujoco.MjSpec
        The model.
    map : Map
        The map.
    body : str, optional
        The body whose frame is that of the patch's link; by default the one of the link's name.
    patch : str, optional
        The patch; by default the only one. `attach_all` takes all of them.
    level : int
        The level; a patch without it has its coarsest level.
    name : str, optional
        Name of the sensor; by default that of the patch.

    Returns
    -------
    str
        The name of the sensor.

    Raises
    ------
    ImportError
        If mujoco is not installed.
    DataError
        If the model has no such body, or the map no such patch or level.
    """
    mujoco, np = need("mujoco", "mujoco"), need("numpy", "mujoco")
    check_kind("spec", spec, mujoco.MjSpec, A_SPEC)
    check_kind("map", map, Map, A_MAP)
    body, name = (None if given is None else word_of(argument, given, "a name") for argument, given in (("body", body), ("name", name)))
    if patch is None and len(map.patches) > 1:
        raise DataError(f"patch: found None of {len(map.patches)}; needed: one of {list(map.patches)[:10]}, or attach_all")
    of, whole = level_of(map, patch, level), patch_of(map, patch)
    name = name or whole.name
    if spec.body(body or whole.link) is None:
        known = [each.name for each in spec.bodies]
        raise DataError(f"body: found {body or whole.link!r}; needed: a body of the model, one of {known[:10]}")
    _refuse_taken(spec, name)
    if of.tangents is None:
        raise DataError("map: found no tangents; needed: a map with tangents")
    if len(of.positions) < LEAST_VERTICES:
        raise DataError(f"level: found {len(of.positions)} vertices of {whole.name!r}; needed: {LEAST_VERTICES} for a mesh of MuJoCo")
    # MuJoCo takes for each vertex its normal, its tangent and their product.
    frames = np.concatenate([of.normals, of.tangents, np.cross(of.normals, of.tangents)], axis=1)
    spec.add_mesh(
        name=name,
        uservert=of.positions.ravel().tolist(),
        userface=of.faces.astype(np.int32).ravel().tolist(),
        usernormal=frames.ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        # The default class of the model may have a scale and a pose of its own.
        scale=[1, 1, 1],
        refpos=[0, 0, 0],
        refquat=[1, 0, 0, 0],
    )
    geom = spec.body(body or whole.link).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        pos=[0, 0, 0],
        quat=[1, 0, 0, 0],
        mass=0,
        contype=0,
        conaffinity=0,
        group=3,
    )
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_TACTILE,
        objtype=mujoco.mjtObj.mjOBJ_MESH,
        objname=name,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname=name,
    )
    return name


def attach_all(spec: Any, map: Map, *, bodies: Mapping[str, str] | None = None, level: int = 0) -> dict[str, str]:
    """Add a sensor for every patch of a map to a `mujoco.MjSpec`.

    Parameters
    ----------
    bodies : mapping of str to str, optional
        The body of each link whose name is not that of a body.

    Returns
    -------
    dict of str to str
        The sensor of each patch, in the order of the map: what `readings` takes.

    Raises
    ------
    ImportError
        If mujoco is not installed.
    DataError
        If the model has no such body, or the map no such patch or level.
    """
    check_kind("spec", spec, need("mujoco", "mujoco").MjSpec, A_SPEC)
    check_kind("map", map, Map, A_MAP)
    needed = f"names of bodies by links of the map, {list(map.links)[:10]}"
    bodies = {word_of("bodies", link, needed): word_of("bodies", body, needed) for link, body in mapping_of("bodies", {} if bodies is None else bodies, needed).items()}
    unknown = set(bodies) - set(map.links)
    if unknown:
        raise DataError(f"bodies: found {sorted(unknown)[0]!r}; needed: {needed}")
    for name, patch in map.patches.items():  # All or none.
        if spec.body(bodies.get(patch.link, patch.link)) is None:
            raise DataError(f"bodies: found {bodies.get(patch.link, patch.link)!r} for patch {name!r}; needed: a body of the model")
        _refuse_taken(spec, name)
    return {
        name: attach(spec, map, patch=name, level=level, body=bodies.get(patch.link)) for name, patch in map.patches.items()
    }


def _refuse_taken(spec: Any, name: str) -> None:
    """Refuses a name that the model has already, before anything is added."""
    for kind, known in (("mesh", spec.meshes), ("geom", spec.geoms), ("sensor", spec.sensors)):
        if any(each.name == name for each in known):
            raise DataError(f"name: found {name!r}, which is a {kind} of the model; needed: a new name")


def readings(data: Any, sensor: str | Map | Mapping[str, str], *, level: int = 0) -> Any:
    """What sensors feel: (3, n) array of the depth (m) and the slip along tangent and binormal (m/s).

    Parameters
    ----------
    data : mujoco.MjData
        The state.
    sensor : str, Map or mapping of str to str
        The name that `attach` returned; or a map, or what `attach_all` returned, for all patches: (3, N) in the order of the
        map, as `Map.pool` and `Map.renderer` take them (level 0), or of the fields of a level.
    level : int
        The level that is attached, if a map is given.

    Raises
    ------
    DataError
        If the model has no such sensor.
    """
    np = need("numpy", "mujoco")
    check_kind("data", data, need("mujoco", "mujoco").MjData, "a mujoco.MjData")
    if isinstance(sensor, str):
        return _felt(data, sensor)
    if isinstance(sensor, Map):
        parts = [(name, len(of.areas)) for name, of, _ in fields_of(sensor, level)]
    else:
        needed = "the name of a sensor, a Map, or what attach_all returned"
        parts = [(word_of("sensor", name, needed), -1) for name in mapping_of("sensor", sensor, needed).values()]
        if not parts:
            raise DataError(f"sensor: found no name; needed: {needed}")
    made: list[Any] = []
    for name, count in parts:
        felt = _felt(data, name)
        if count not in (-1, felt.shape[1]):
            raise DataError(f"sensor {name!r}: found {felt.shape[1]} vertices; needed: {count}, those of level {level}")
        made.append(felt)
    return np.concatenate(made, axis=1)


def _felt(data: Any, name: str) -> Any:
    try:
        return data.sensor(name).data.reshape(3, -1).copy()
    except KeyError:
        raise DataError(f"sensor: found {name!r}; needed: a sensor of the model, as attach returns it") from None


def skin(
    model: Any,
    *,
    bodies: Sequence[str] | None = None,
    spacing: float | Mapping[str, float] | None = None,
    visual: bool = False,
    weld: Literal["auto", "all", "none"] = "auto",
    repair: bool | None = None,
    fill_holes: int | None = None,
    keep_going: bool = False,
    outer: bool = False,
    least_area: float | None = None,
) -> Skin:
    """A skin of the geoms of a model, meshes and primitives, in the frames of their bodies.

    Each body is a link, each of its geoms one patch or more.

    Parameters
    ----------
    model : mujoco.MjModel, mujoco.MjSpec, str or os.PathLike
        The model, or its file.
    bodies : sequence of str, optional
        The bodies that are covered; by default all that have geoms.
    spacing : float or mapping of str to float, optional
        Spacing of the taxels, in m. Primitives need it.
    visual : bool
        Whether geoms that do not collide are covered instead of those that do. A body without any of the wanted kind has
        the others.
    weld, repair, fill_holes, keep_going, outer, least_area
        As in `Skin.read`.

    Raises
    ------
    ImportError
        If mujoco is not installed.
    DataError
        If there is no such body, or its geoms are no skin.

    Examples
    --------
    >>> import dermatome.mujoco, mujoco
    >>> model = mujoco.MjModel.from_xml_string(
    ...     '<mujoco><worldbody><body name="tip"><geom type="sphere" size="0.01"/></body></worldbody></mujoco>')
    >>> dermatome.mujoco.skin(model, spacing=0.003).links
    ('world', 'tip')
    """
    mujoco = need("mujoco", "mujoco")
    bodies, visual = None if bodies is None else words_of("bodies", bodies, "names of bodies"), flag_of("visual", visual)
    if isinstance(model, mujoco.MjSpec):
        model = model.compile()
    elif not isinstance(model, mujoco.MjModel):
        name = path_of("model", model, "a mujoco.MjModel or MjSpec, or a path")
        try:
            model = mujoco.MjModel.from_xml_path(name)
        except ValueError as error:
            raise DataError(f"model: found {name}: {error}; needed: a model that MuJoCo reads") from error
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(_covered(mujoco, model, bodies, visual), encoding="utf-8")
        return Skin.read(
            path,
            spacing=spacing,
            weld=weld,
            repair=repair,
            fill_holes=fill_holes,
            keep_going=keep_going,
            outer=outer,
            least_area=least_area,
        )


def _covered(mujoco: Any, model: Any, wanted: Sequence[str] | None, visual: bool) -> str:
    """A model of MJCF with the geoms that are covered alone, in the frames of the bodies."""
    names = [model.body(k).name or f"body{k}" for k in range(model.nbody)]
    unknown = [name for name in wanted or () if name not in names]
    if unknown:
        raise DataError(f"bodies: found {unknown[0]!r}; needed: bodies of the model, {names[:10]}")
    chosen: list[list[int]] = [[] for _ in names]
    for body, name in enumerate(names):
        first = model.body_geomadr[body]
        flat = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
        geoms = [k for k in range(first, first + model.body_geomnum[body]) if int(model.geom_type[k]) not in flat]
        if wanted is None or name in wanted:
            fit = [k for k in geoms if bool(model.geom_contype[k] or model.geom_conaffinity[k]) != visual]
            chosen[body] = fit or geoms
    if not any(chosen):
        raise DataError(f"bodies: found none with a mesh or a primitive; needed: at least one of {names[:10]}")
    meshes = sorted({int(model.geom_dataid[k]) for of in chosen for k in of if model.geom_type[k] == int(mujoco.mjtGeom.mjGEOM_MESH)})
    assets = "".join(_mesh(model, mesh) for mesh in meshes)
    children: list[list[int]] = [[] for _ in names]
    for body in range(1, model.nbody):
        children[int(model.body_parentid[body])].append(body)

    lines: list[str] = []
    open_bodies = [(0, False)]
    while open_bodies:
        body, is_done = open_bodies.pop()
        if is_done:
            lines.append("</body>")
            continue
        if body:
            lines.append(f"<body name={quoteattr(names[body])} {_pose(model.body_pos[body], model.body_quat[body])}>")
            open_bodies.append((body, True))
        lines += [_geom(mujoco, model, geom) for geom in chosen[body]]
        open_bodies += [(child, False) for child in reversed(children[body])]
    world = "".join(lines)
    return f'<mujoco><compiler angle="radian"/><asset>{assets}</asset><worldbody>{world}</worldbody></mujoco>'


def _numbers(values: Any) -> str:
    return " ".join(f"{number:.17g}" for number in values)


def _pose(pos: Any, quat: Any) -> str:
    return f'pos="{_numbers(pos)}" quat="{_numbers(quat)}"'


def _mesh(model: Any, mesh: int) -> str:
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].ravel()
    faces = model.mesh_face[face : face + model.mesh_facenum[mesh]].ravel()
    return f'<mesh name="mesh{mesh}" vertex="{_numbers(vertices)}" face="{" ".join(map(str, faces))}"/>'


def _geom(mujoco: Any, model: Any, geom: int) -> str:
    kinds = {
        int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
        int(mujoco.mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
        int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", 3),
        int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
        int(mujoco.mjtGeom.mjGEOM_BOX): ("box", 3),
        int(mujoco.mjtGeom.mjGEOM_MESH): ("mesh", 0),
    }
    name = model.geom(geom).name
    number = int(model.geom_type[geom])
    if number not in kinds:
        raise DataError(f"geom {name or geom}: found the type {number}; needed: a mesh or a primitive")
    kind, sizes = kinds[number]
    shape = f'mesh="mesh{model.geom_dataid[geom]}"' if kind == "mesh" else f'size="{_numbers(model.geom_size[geom][:sizes])}"'
    named = f"name={quoteattr(name)} " if name else ""
    return f'<geom {named}type="{kind}" {shape} {_pose(model.geom_pos[geom], model.geom_quat[geom])}/>'
