"""From the log of a robot that touches its skin to contacts."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal

from dermatome._arguments import READINGS, check_kind, flag_of, items_of, mapping_of, number_of, path_of, whole_of, word_of
from dermatome._dermatome import Map, Observations, Skin, contacts_of_log
from dermatome._errors import DataError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from dermatome._readings import Readings


def touches(
    log: str | os.PathLike[str] | Mapping[str, ArrayLike | Sequence[Mapping[int, float]]],
    *,
    skin: Skin | Map | str | os.PathLike[str] | None = None,
    readings: Readings | str | os.PathLike[str] | None = None,
    threshold: float | None = None,
    pose: str | os.PathLike[str] | None = None,
    joints: Mapping[str, float] | str | os.PathLike[str] | None = None,
    fit_joints: bool = False,
    link: str | None = None,
    radius: float | None = None,
    taxel_radius: float = 0.002,
    stiffness: float | None = None,
    arm_noise: float | None = None,
    delay: float | Literal["auto"] = "auto",
    skip: Iterable[int] = (),
    threads: int = 0,
) -> tuple[Observations, dict[str, Any]]:
    """Turn the log of a robot that touches its skin into contacts for `calibrate`, as `dermatome touches`.

    Parameters
    ----------
    log : str, os.PathLike or mapping of str to (k,) array_like
        A row for each frame: a table, or its columns (docs/files.md): `px`, `py`, `pz`, the centre of the sphere that touches,
        and, unless `pose` or `readings` has them, `x`, `y`, `z`, `qx`, `qy`, `qz`, `qw`, the pose of the link that carries
        the skin, and `taxels`, for each frame a dict of id to reading, or ids. `probe_link` names another link that touches.
    skin : Skin, Map, str or os.PathLike, optional
        A drawing of the skin, in the frame of the link: its taxels have their normals and neighbours from it.
    readings : Readings, str or os.PathLike, optional
        Readings of the taxels, at the times of the log, if it has no column `taxels`; without ids those of all taxels of `skin`
        in its order.
    threshold : float, optional
        A taxel is active above this, in the unit of the readings; by default the one that `readings` state, or five times the noise.
    pose : str or os.PathLike, optional
        Poses of links: a table, or a robot (.urdf, .xml), with `joints`.
    joints : mapping of str to float, str or os.PathLike, optional
        Values of the joints of the robot, in rad and m: one for each, or a table of them over time; by default 0.
    fit_joints : bool
        Whether contacts have how each touch moves with the joints between the skin and what touches it, for `calibrate(fit_joints=True)`.
    link : str, optional
        The link whose skin is touched, if the log has several.
    radius : float, optional
        Radius of the sphere that touches, in m, if the log has no column `radius`.
    taxel_radius : float
        Radius of the disc on which a taxel feels, in m (0.002).
    stiffness : float, optional
        Pressure over depth, in Pa/m, if readings are forces or pressures, without a unit in N; by default it is estimated.
    arm_noise : float, optional
        Noise of the arm's position, in m per axis; by default it is estimated.
    delay : float or "auto"
        How late the readings are next to the poses, in s; "auto": estimated, and taken off beyond five standard deviations.
    skip : iterable of int
        Ids of taxels that are left out.
    threads : int
        0 for one per processor.

    Returns
    -------
    contacts : Observations
        What `calibrate` takes; `write` writes it to a table, and `remarks` are the notes of the command.
    summary : dict
        How they were found: `frames`, `touches`, `taxels`, `contacts`, `fitted`, `left_out`, `delay`, `delay_sigma`,
        `delay_removed` (s), `arm_noise` (m), `reading_noise`, `spacing` (m), `joints`; docs/json.md explains them.

    Raises
    ------
    MissingFileError, FileError
        If it does not exist, or cannot be read.
    DataError
        If a row or option cannot be used, or the log does not determine the contacts: the message says which.

    Examples
    --------
    >>> import dermatome
    >>> finger = {"px": [0, 0.01], "py": [0, 0], "pz": [0, 0]}
    >>> still = {"x": [0, 0], "y": [0, 0], "z": [0, 0], "qx": [0, 0], "qy": [0, 0], "qz": [0, 0], "qw": [1, 1]}
    >>> contacts, summary = dermatome.touches({**finger, **still, "touch": [1, 2], "taxels": [[7, 8], [8, 9]]})
    >>> contacts, summary["touches"]
    (<dermatome.Observations: 3 taxels, 0 displacements, 4 contacts>, 2)
    """
    for name, number in (("radius", radius), ("stiffness", stiffness), ("arm_noise", arm_noise), ("threshold", threshold)):
        if number is not None:
            number_of(name, number, "a number, or None")
    taxel_radius = number_of("taxel_radius", taxel_radius, "a length in m")
    if joints is not None and not isinstance(joints, (str, os.PathLike)):
        needed = "a value for each joint by its name, or the path of a table"
        joints = {word_of("joints", name, needed): number_of("joints", value, needed) for name, value in mapping_of("joints", joints, needed).items()}
    arguments = {
        "skin": Skin.read(skin) if isinstance(skin, (str, os.PathLike)) else skin,
        # Taxels of the log may be in no triangle of the file, and so not in the skin.
        "drawing": skin if isinstance(skin, (str, os.PathLike)) else None,
        "readings": None if readings is None else _readings(readings, skin is not None),
        "threshold": threshold,
        "pose": None if pose is None else path_of("pose", pose),
        "joints": joints,
        "fit_joints": flag_of("fit_joints", fit_joints),
        "link": None if link is None else word_of("link", link, "the name of a link"),
        "radius": radius,
        "taxel_radius": taxel_radius,
        "stiffness": stiffness,
        "arm_noise": arm_noise,
        "delay": None if isinstance(delay, str) and delay == "auto" else number_of("delay", delay, '"auto", or a number of seconds'),
        "skip": [whole_of("skip", taxel, "ids of taxels") for taxel in items_of("skip", skip, "ids of taxels")],
        "threads": whole_of("threads", threads, "a number of threads"),
    }
    if fit_joints and joints is None:
        raise DataError("fit_joints: found no joints; needed: pose, a robot, and joints, the values of its joints")
    if threshold is not None and readings is None:
        raise DataError("threshold: found no readings; needed: readings, or a log whose active taxels are known")
    if isinstance(log, (str, os.PathLike)):
        return contacts_of_log(log, arguments)
    from dermatome._columns import table

    return contacts_of_log({"text": table("log", log)}, arguments)


def _readings(source: Readings | str | os.PathLike[str], has_skin: bool) -> tuple[Any, Any, Any, str, str, float | None]:
    """Times, ids or None, values, name and unit of the channel, and the threshold that the readings state."""
    from dermatome._readings import Readings

    readings = Readings.read(source) if isinstance(source, (str, os.PathLike)) else source
    check_kind("readings", readings, Readings, f"{READINGS}, or their path")
    if readings.values.shape[1] != 1:
        raise DataError(f"readings: found {readings.values.shape[1]} channels; needed: a recording with one")
    if readings.ids is None and not has_skin:
        raise DataError("readings: found no ids of taxels; needed: ids, or skin, whose taxels the columns are in its order")
    return readings.timestamps, readings.ids, readings.values[:, 0], readings.channels[0], readings.units[0], readings.threshold


touches.__module__ = "dermatome"
