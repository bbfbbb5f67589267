"""Where taxels are, or the bodies that carry them: at once, and touch by touch."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NoReturn, overload

from dermatome._dermatome import (
    Calibration,
    Map,
    Observations,
    Skin,
    TouchFollower,
    TouchLines,
    calibrate_taxels,
    fit_bodies,
    write_taxels_of_bodies,
)
from dermatome._errors import DataError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    _Path = str | os.PathLike[str]
    _Robust = Literal["auto", "none", "huber", "tukey", "gnc"]
    _Residual = Literal["split", "log", "quaternion"]
    _Initial = Literal["chordal", "tree", "file"]
    _Level = Literal["mount", "patch", "module"]
    _Unit = Literal["m", "mm", "cm", "in"] | float

# What the options are without a drawing, and with one, unless they are given.
OF_TAXELS: dict[str, Any] = {"robust": "auto", "residual": "split", "initial": "chordal", "iterations": 100, "covariances": True}
OF_BODIES: dict[str, Any] = {
    "modules": None,
    "level": "module",
    "mount": None,
    "mount_angle": None,
    "patch": None,
    "patch_angle": None,
    "module": None,
    "module_angle": None,
    "fit_probe": False,
    "fit_standoff": False,
    "as_drawn": False,
    "folds": None,
    "seed": 0,
}
# Standard deviations of an offset of the probe and of a standoff, in m, as those of the command.
PROBE, STANDOFF = 0.02, 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A body that carries taxels: the mount, a patch or a module. Motions are relative to the body that carries it.

    Attributes
    ----------
    level : {"mount", "patch", "module"}
        What it is.
    name : str
        The name of the patch or the module; "mount" of the mount.
    contacts : int
        Contacts of its taxels, without rejected ones.
    moved, turned : float
        How far its centre moved, in m, and how far it turned, in rad.
    translation, rotation : (3,) float64 array
        The same as vectors.
    sigma, sigma_turned : float or None
        Standard deviations of both, in m and rad; None: it does not move.
    chi2, p : float or None
        The test of its motion against its tolerance; None without a contact.
    dof : int or None
        Numbers of the motion that the touches determine.
    believable : bool or None
        Whether the drawing is believable: `p` of 0.001 or more.
    """

    level: str
    name: str
    contacts: int
    moved: float
    turned: float
    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]
    sigma: float | None
    sigma_turned: float | None
    chi2: float | None
    dof: int | None
    p: float | None
    believable: bool | None

    def __repr__(self) -> str:
        motion = f"moved {1e3 * self.moved:.2f} mm, turned {math.degrees(self.turned):.2f} degrees"
        name = self.level if self.level == "mount" else f"{self.level} {self.name}"
        return f"<dermatome.Body: {name}, {self.contacts} contacts, {motion}>"


@dataclass(frozen=True, eq=False, repr=False)
class ProbeOffset:
    """The offset of the probe in its own frame.

    Attributes
    ----------
    offset, sigma : (3,) float64 array
        The offset and the standard deviation of each axis, in m.
    """

    offset: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def __repr__(self) -> str:
        axes = (f"{1e3 * offset:.1f} +- {1e3 * sigma:.1f}" for offset, sigma in zip(self.offset, self.sigma))
        return f"<dermatome.ProbeOffset: {', '.join(axes)} mm>"


@dataclass(frozen=True)
class LevelScore:
    """How well contacts that were held back are predicted if bodies move down to a level.

    Attributes
    ----------
    level : {"mount", "patch", "module"}
        The last level that moved.
    median, p90 : float
        Median and 90 % of the distances of touches from their predictions, in m.
    contact_median, contact_mean : float
        Median and mean over contacts of the mean distance of their touches, in m.
    """

    level: str
    median: float
    p90: float
    contact_median: float
    contact_mean: float


@dataclass(frozen=True)
class HeldBack:
    """The prediction of contacts that were held back.

    Attributes
    ----------
    supported : {"mount", "patch", "module"}
        The last level that predicts contacts better than those before it.
    levels : tuple of LevelScore
        The score of each level.
    """

    supported: str
    levels: tuple[LevelScore, ...]


@dataclass(frozen=True, eq=False, repr=False)
class BodyCalibration:
    """Where the bodies of a drawn skin are, and its taxels with them.

    Attributes
    ----------
    ids : (n,) uint32 array
        Ids of the taxels, in the order of the drawing.
    positions, normals : (n, 3) float64 array
        Where the taxels are, in m, and their normals, NaN where the drawing has none.
    covariances : (n, 6) float64 array
        Covariances of the positions, xx, xy, xz, yy, yz, zz, in m^2.
    modules, patches : tuple of str
        The module and the patch of each taxel.
    touches, contacts : int
        How many there are.
    rejected : (k,) uint32 array
        Touches that are outliers, numbered in the order of their first rows.
    chi2, dof : float
        Squared whitened errors of inliers and motions over their tolerances; numbers that the inliers observe.
    noise : (4, 2) float64 array or None
        Standard deviations along the normal and per axis of the tangent plane, in m, of touches of 1, 2, 3 and more taxels; None:
        the observations state them.
    probe : ProbeOffset or None
        The offset of the probe, if it is fitted.
    standoff, standoff_sigma : float or None
        Distance of touches from taxels along their normals, and its standard deviation, in m, if it is fitted.
    bodies : tuple of Body
        The mount, then the patches, then the modules.
    exchanged : tuple of (str, str)
        Modules that fit best in each other's place.
    turned : tuple of (str, float)
        Modules that fit best turned about their outward normal, and by which angle, in rad.
    untouched : tuple of str
        Modules without a touch: they keep their drawn pose on their patch.
    held_back : HeldBack or None
        The prediction of contacts that were held back, with `folds`.
    steps : int
        Steps of the fit.
    converged : bool
        Whether the last step was negligible.
    remarks : tuple of str
        What was assumed, and what looks wrong.
    """

    ids: NDArray[np.uint32]
    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    covariances: NDArray[np.float64]
    modules: tuple[str, ...]
    patches: tuple[str, ...]
    touches: int
    contacts: int
    rejected: NDArray[np.uint32]
    chi2: float
    dof: float
    noise: NDArray[np.float64] | None
    probe: ProbeOffset | None
    standoff: float | None
    standoff_sigma: float | None
    bodies: tuple[Body, ...]
    exchanged: tuple[tuple[str, str], ...]
    turned: tuple[tuple[str, float], ...]
    untouched: tuple[str, ...]
    held_back: HeldBack | None
    steps: int
    converged: bool
    remarks: tuple[str, ...]
    _skin: Skin | str

    def skin(self) -> Skin:
        """The drawing with its taxels where the fit places them."""
        if isinstance(self._skin, str):
            raise DataError(f"cad: {self._skin}")
        return self._skin

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the taxels to a table .csv, which is a drawing again, or the skin to another file, as .glb."""
        if os.fspath(path).lower().endswith(".csv"):
            arrays = (self.ids.tolist(), self.positions.tolist(), self.normals.tolist(), self.covariances.tolist())
            write_taxels_of_bodies(path, *arrays, list(self.modules), list(self.patches))
        else:
            self.skin().write(path)

    def __repr__(self) -> str:
        ending = "converged" if self.converged else "not converged"
        counts = f"{len(self.ids)} taxels, {len(self.bodies)} bodies, {self.touches} touches, {self.contacts} contacts"
        return f"<dermatome.BodyCalibration: {counts}, {ending}>"


@dataclass(frozen=True, eq=False, repr=False)
class FollowedTouch:
    """What a touch changed.

    Attributes
    ----------
    touch : int
        Its number, from 1.
    taxels : tuple of int
        Ids of its taxels.
    time : float or None
        The column `time` of its last row, in s.
    sigmas : float or None
        Length of the whitened innovation; None: nothing that it measures was known, or the bodies of a drawing are fitted.
    dof : int or None
        Dimensions of the innovation.
    fits : bool or None
        Whether the stated noise explains it: of true touches one in a thousand does not fit.
    moved : float or None
        Largest motion of a taxel that was known before, in m; None without a solve.
    worst : tuple of (int, float) or None
        The least certain taxel and its standard deviation, in m.
    undetermined : int or None
        A taxel that the observations so far do not determine.
    """

    touch: int
    taxels: tuple[int, ...]
    time: float | None
    sigmas: float | None
    dof: int | None
    fits: bool | None
    moved: float | None
    worst: tuple[int, float] | None
    undetermined: int | None

    def __repr__(self) -> str:
        fit = {None: "", True: ", fits", False: ", does not fit"}[self.fits]
        moved = "" if self.moved is None else f", moved {1e3 * self.moved:.3f} mm"
        return f"<dermatome.FollowedTouch: touch {self.touch} of taxels {list(self.taxels)}{fit}{moved}>"


class Following(Iterator[FollowedTouch]):
    """An iterator over touches as they come, made by `follow`.

    Attributes
    ----------
    remarks : list of str
        What was assumed, each once.
    """

    def __init__(self, rows: Iterable[Any], follower: TouchFollower, unit: Any) -> None:
        self.remarks: list[str] = []
        self._rows, self._follower, self._unit = iter(rows), follower, unit
        self._lines: TouchLines | None = None
        self._result: Calibration | BodyCalibration | None = None

    def __iter__(self) -> Following:
        return self

    def __next__(self) -> FollowedTouch:
        observations, time = self._observed()
        for remark in observations.remarks:
            if remark not in self.remarks:
                self.remarks.append(remark)
        number, taxels, sigmas, dof, fits, moved, worst, undetermined = self._follower.push(observations)
        self._result = None
        return FollowedTouch(number, tuple(taxels), time, sigmas, dof, fits, moved, worst, undetermined)

    @property
    def result(self) -> Calibration | BodyCalibration:
        """Calibration or BodyCalibration: That of all touches so far, as `calibrate` finds it."""
        if self._result is None:
            found = self._follower.finish()
            self._result = _bodies(found) if isinstance(found, dict) else found
        return self._result

    def __reduce__(self) -> NoReturn:
        raise TypeError("cannot pickle 'Following': it stands at a touch of what it reads")

    def _observed(self) -> tuple[Observations, float | None]:
        """The next touch, and its time."""
        if self._lines is not None:
            return self._of_lines(self._lines)
        row = next(self._rows)
        if isinstance(row, str):
            self._lines = TouchLines(_before(row, self._rows), self._unit)
            return self._of_lines(self._lines)
        if isinstance(row, Observations):
            return row, None
        times = row.get("time") if isinstance(row, Mapping) else None
        try:
            last = times[-1] if times is not None and hasattr(times, "__getitem__") else times
        except IndexError:  # An array without axes.
            last = times
        return Observations.from_columns(row, unit=self._unit), None if last is None else float(last)

    def _of_lines(self, lines: TouchLines) -> tuple[Observations, float | None]:
        read = lines.next()
        if read is not None:
            return read
        if lines.half_row is not None:
            remark = f"line {lines.half_row} has no end and was not read"
            self.remarks += [] if remark in self.remarks else [remark]
        raise StopIteration


def _before(first: str, rest: Iterator[str]) -> Iterator[str]:
    yield first
    yield from rest


@overload
def calibrate(
    observations: Observations | _Path,
    *,
    robust: _Robust = "auto",
    residual: _Residual = "split",
    initial: _Initial = "chordal",
    iterations: int = 100,
    covariances: bool = True,
    cad: None = None,
    threads: int = 0,
) -> Calibration: ...
@overload
def calibrate(
    observations: Observations | _Path,
    *,
    cad: Skin | Map | _Path,
    modules: Mapping[int, str] | _Path | None = None,
    level: _Level = "module",
    mount: float | None = None,
    mount_angle: float | None = None,
    patch: float | None = None,
    patch_angle: float | None = None,
    module: float | None = None,
    module_angle: float | None = None,
    fit_probe: bool | float = False,
    fit_standoff: bool | float = False,
    as_drawn: bool = False,
    folds: int | None = None,
    seed: int = 0,
    threads: int = 0,
) -> BodyCalibration: ...
def calibrate(
    observations: Observations | _Path,
    *,
    robust: str = "auto",
    residual: str = "split",
    initial: str = "chordal",
    iterations: int = 100,
    covariances: bool = True,
    cad: Skin | Map | _Path | None = None,
    modules: Mapping[int, str] | _Path | None = None,
    level: str = "module",
    mount: float | None = None,
    mount_angle: float | None = None,
    patch: float | None = None,
    patch_angle: float | None = None,
    module: float | None = None,
    module_angle: float | None = None,
    fit_probe: bool | float = False,
    fit_standoff: bool | float = False,
    as_drawn: bool = False,
    folds: int | None = None,
    seed: int = 0,
    threads: int = 0,
) -> Calibration | BodyCalibration:
    """Find where taxels are from noisy observations of them, with a covariance for each; with `cad` the bodies that carry them.

    Parameters
    ----------
    observations : Observations, str or os.PathLike
        What was observed, or a file of it.
    robust : {"auto", "none", "huber", "tukey", "gnc"}
        How outliers are treated.
    residual : {"split", "log", "quaternion"}
        How the error of a relative pose becomes six numbers.
    initial : {"chordal", "tree", "file"}
        Where to start.
    iterations : int
        Most iterations of one solve.
    covariances : bool
        Whether covariances are computed.
    cad : Skin, Map, str or os.PathLike, optional
        The skin as drawn, with ids of taxels, in the frame of the contacts: touches move its mount, patches and modules. Its
        noise is estimated where the file of the observations has none.
    modules : mapping of int to str, str or os.PathLike, optional
        The module of each taxel, by its id, or a table of them; by default a column of the drawing, else its pieces.
    level : {"mount", "patch", "module"}
        The last bodies that move.
    mount, patch, module : float, optional
        How far bodies may be from where the one before carries them: standard deviations, in m per axis (0.05, 0.003, 0.001).
    mount_angle, patch_angle, module_angle : float, optional
        How far they may be turned, in rad per axis (30, 6 and 4.5 degrees).
    fit_probe : bool or float
        Fit a constant offset of the probe in its own frame, of this standard deviation, in m; True is 0.02.
    fit_standoff : bool or float
        Fit a constant distance between taxels and touches along the normals; True is 0.01.
    as_drawn : bool
        Fit modules that look exchanged or turned as they are drawn.
    folds : int, optional
        Predict each of so many groups of contacts from the others, and find which bodies the touches support.
    seed : int
        Seed of the groups.
    threads : int
        0 for one per processor.

    Returns
    -------
    Calibration or BodyCalibration
        The latter with `cad`.

    Examples
    --------
    >>> import dermatome
    >>> observations, truth = dermatome.simulate(taxels=50)
    >>> found = dermatome.calibrate(observations)
    >>> found.converged, found.skin().n_taxels
    (True, 50)
    >>> skin = found.skin()
    >>> x, y, z = (skin.positions + [0.002, 0, 0]).T
    >>> contacts = dermatome.Observations.from_columns({"i": skin.ids, "x": x, "y": y, "z": z, "sigma": [1e-3] * 50})
    >>> dermatome.calibrate(contacts, cad=skin, level="mount").bodies[0]
    <dermatome.Body: mount, 50 contacts, moved 2.00 mm, turned 0.00 degrees>
    """
    taxels = {"robust": robust, "residual": residual, "initial": initial, "iterations": iterations, "covariances": covariances}
    bodies = {
        "modules": modules,
        "level": level,
        "mount": mount,
        "mount_angle": mount_angle,
        "patch": patch,
        "patch_angle": patch_angle,
        "module": module,
        "module_angle": module_angle,
        "fit_probe": fit_probe,
        "fit_standoff": fit_standoff,
        "as_drawn": as_drawn,
        "folds": folds,
        "seed": seed,
    }
    _check(cad, taxels, bodies)
    observed = observations if isinstance(observations, Observations) else Observations.read(observations)
    if cad is None:
        return calibrate_taxels(observed, taxels, threads)
    return _bodies(fit_bodies(observed, cad, *_of_bodies(bodies), threads))


def follow(
    rows: Iterable[str] | Iterable[Observations] | Iterable[Mapping[str, ArrayLike]],
    *,
    every: int = 1,
    unit: _Unit | None = None,
    robust: _Robust = "auto",
    covariances: bool = True,
    cad: Skin | Map | _Path | None = None,
    modules: Mapping[int, str] | _Path | None = None,
    level: _Level = "module",
    mount: float | None = None,
    mount_angle: float | None = None,
    patch: float | None = None,
    patch_angle: float | None = None,
    module: float | None = None,
    module_angle: float | None = None,
    fit_probe: bool | float = False,
    fit_standoff: bool | float = False,
    as_drawn: bool = False,
    threads: int = 0,
) -> Following:
    """Calibrate touch by touch, as `dermatome calibrate --follow`: an iterator over what each touch changes.

    A bad touch raises an error; `result` is then that of those before it.

    Parameters
    ----------
    rows : iterable of str, Observations or mapping of str to (k,) array_like
        Lines of a table, the names of its columns first, as of a file or a socket, where rows with one number in a column
        `touch` are a touch; or touches, each as observations or as columns (`Observations.from_columns`).
    every : int
        Solve after so many touches.
    unit : {"m", "mm", "cm", "in"} or float
        Unit of all lengths in lines and columns.
    robust, covariances
        As of `calibrate`.
    cad, modules, level, mount, mount_angle, patch, patch_angle, module, module_angle, fit_probe, fit_standoff, as_drawn
        As of `calibrate`.
    threads : int
        0 for one per processor.

    Returns
    -------
    Following

    Examples
    --------
    >>> import dermatome
    >>> lines = ["i,x,y,z,sigma", "7,0,0,0,0.001", "7,0.001,0,0,0.001"]
    >>> touches = dermatome.follow(lines)
    >>> list(touches)[-1]
    <dermatome.FollowedTouch: touch 2 of taxels [7], fits, moved 0.500 mm>
    >>> float(touches.result.positions[0, 0].round(6))
    0.0005
    """
    taxels = {**OF_TAXELS, "robust": robust, "covariances": covariances}
    bodies = {
        **OF_BODIES,
        "modules": modules,
        "level": level,
        "mount": mount,
        "mount_angle": mount_angle,
        "patch": patch,
        "patch_angle": patch_angle,
        "module": module,
        "module_angle": module_angle,
        "fit_probe": fit_probe,
        "fit_standoff": fit_standoff,
        "as_drawn": as_drawn,
    }
    _check(cad, taxels, bodies)
    if every < 1:
        raise DataError(f"every: found {every}; needed: a number of touches, at least 1")
    if isinstance(rows, (str, bytes, Mapping, Observations)):
        raise DataError(f"rows: found {type(rows).__name__}; needed: an iterable of lines or of touches")
    if cad is None:
        return Following(rows, TouchFollower.of_taxels(taxels, every, threads), unit)
    return Following(rows, TouchFollower.of_bodies(cad, *_of_bodies(bodies), every, threads), unit)


def _check(cad: Any, taxels: dict[str, Any], bodies: dict[str, Any]) -> None:
    """Refuses options of the other kind of calibration."""
    given, known = (bodies, OF_BODIES) if cad is None else (taxels, OF_TAXELS)
    found = "no cad" if cad is None else "cad, too"
    for name, value in given.items():
        default = known[name]
        if value is not default and not (isinstance(value, (int, float, str)) and value == default):
            needed = "cad, the skin as drawn" if cad is None else "one of the two"
            raise DataError(f"{name}: found {found}; needed: {needed}")


def _of_bodies(given: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The modules, and the other options as the library takes them."""
    options = dict(given)
    modules = options.pop("modules")
    if isinstance(modules, Mapping):
        modules = {int(taxel): str(module) for taxel, module in modules.items()}
    for name, known in (("fit_probe", PROBE), ("fit_standoff", STANDOFF)):
        value = options[name]
        options[name] = (known if value else None) if isinstance(value, bool) or value is None else value
    return modules, options


def _bodies(found: dict[str, Any]) -> BodyCalibration:
    """A calibration of what the library found."""
    held_back = found["held_back"]
    made = {
        **found,
        "modules": tuple(found["modules"]),
        "patches": tuple(found["patches"]),
        "probe": None if found["probe"] is None else ProbeOffset(*found["probe"]),
        "bodies": tuple(Body(**body) for body in found["bodies"]),
        "exchanged": tuple(tuple(pair) for pair in found["exchanged"]),
        "turned": tuple(tuple(pair) for pair in found["turned"]),
        "untouched": tuple(found["untouched"]),
        "held_back": None if held_back is None else HeldBack(held_back[0], tuple(LevelScore(*score) for score in held_back[1])),
        "remarks": tuple(found["remarks"]),
        "_skin": found["skin"],
    }
    del made["skin"]
    return BodyCalibration(**made)


for _each in (Body, ProbeOffset, LevelScore, HeldBack, BodyCalibration, FollowedTouch, Following, calibrate, follow):
    _each.__module__ = "dermatome"
