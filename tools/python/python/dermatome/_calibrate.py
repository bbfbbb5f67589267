"""Where taxels are, or the bodies that carry them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, overload

from dermatome._arguments import check_kind, flag_of, whole_of
from dermatome._bodies import BodyCalibration, bodies_of
from dermatome._dermatome import Calibration, Map, Observations, Skin, calibrate_taxels, fit_bodies
from dermatome._errors import DataError
from dermatome._kinds import is_mapping

if TYPE_CHECKING:
    _Path = str | os.PathLike[str]
    _Robust = Literal["auto", "none", "huber", "tukey", "gnc"]
    _Residual = Literal["split", "log", "quaternion"]
    _Initial = Literal["chordal", "file"]
    _Level = Literal["mount", "patch", "module"]

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
    "fit_joints": False,
    "as_drawn": False,
    "folds": 5,
    "seed": 0,
}
# Standard deviations of an offset of the probe and of a standoff, in m, and of offsets of joints, in rad, as those of the command.
PROBE, STANDOFF, JOINTS = 0.02, 0.01, math.radians(1.0)


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
    fit_joints: bool | float = False,
    as_drawn: bool = False,
    folds: int = 5,
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
    fit_joints: bool | float = False,
    as_drawn: bool = False,
    folds: int = 5,
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
    initial : {"chordal", "file"}
        Where to start.
    iterations : int
        Most iterations of one solve.
    covariances : bool
        Whether covariances are computed.
    cad : Skin, Map, str or os.PathLike, optional
        The skin as drawn, with ids of taxels, in the frame of the contacts: touches move its mount, patches and modules. Of the
        stated noise only the shape counts: its scale is estimated.
    modules : mapping of int to str, str or os.PathLike, optional
        The module of each taxel, by its id, or a table of them; by default a column of the drawing, else its pieces.
    level : {"mount", "patch", "module"}
        The last bodies that may move.
    mount, patch, module : float, optional
        How far bodies may be from where the one before carries them: standard deviations, in m per axis (0.05, 0.003, 0.001).
    mount_angle, patch_angle, module_angle : float, optional
        How far they may be turned, in rad per axis (30, 6 and 4.5 degrees).
    fit_probe : bool or float
        Fit a constant offset of the probe in its own frame, of this standard deviation, in m; True is 0.02.
    fit_standoff : bool or float
        Fit a constant distance between taxels and touches along the normals; True is 0.01.
    fit_joints : bool or float
        Fit constant offsets of the joints from their values, of this standard deviation, in rad, True is one degree; of those that slide
        1 mm for each degree. `touches(fit_joints=True)` says how each touch moves with them.
    as_drawn : bool
        Fit modules that look exchanged or turned as they are drawn.
    folds : int
        Number of groups of contacts; each is predicted from the others: the bodies that the touches support move, and the fit is
        judged. Fewer than ten contacts are not judged by 5 groups.
    seed : int
        Seed of the groups.
    threads : int
        0 for one per processor.

    Returns
    -------
    Calibration or BodyCalibration
        The latter with `cad`.

    Raises
    ------
    MissingFileError, FileError
        If it does not exist, or cannot be read.
    DataError
        If an option is of the other kind of calibration or out of its range, a row cannot be used, or the
        observations do not determine the taxels: the message says which.

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
    taxels, bodies = options_of(locals())
    check_options(cad, taxels, bodies)
    needed = "Observations, or the path of a table; Observations.from_columns makes them of arrays"
    check_kind("observations", observations, (Observations, str, os.PathLike), needed)
    observed = observations if isinstance(observations, Observations) else Observations.read(observations)
    if cad is None:
        return calibrate_taxels(observed, taxels, threads)
    return bodies_of(fit_bodies(observed, cad, *options_of_bodies(bodies), threads))


def options_of(given: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The options of taxels and those of bodies among arguments, with the default of each that is not among them."""
    taxels, bodies = ({name: given.get(name, known) for name, known in of.items()} for of in (OF_TAXELS, OF_BODIES))
    for name in ("robust", "residual", "initial"):
        check_kind(name, taxels[name], str, "a word")
    taxels["covariances"] = flag_of("covariances", taxels["covariances"])
    taxels["iterations"] = whole_of("iterations", taxels["iterations"], "a number of steps")
    return taxels, bodies


def check_options(cad: Any, taxels: dict[str, Any], bodies: dict[str, Any]) -> None:
    """Refuses options of the other kind of calibration."""
    given, known = (bodies, OF_BODIES) if cad is None else (taxels, OF_TAXELS)
    found = "no cad" if cad is None else "cad, too"
    for name, value in given.items():
        default = known[name]
        if value is not default and not (isinstance(value, (int, float, str)) and value == default):
            needed = "cad, the skin as drawn" if cad is None else "one of the two"
            raise DataError(f"{name}: found {found}; needed: {needed}")


def options_of_bodies(given: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The modules, and the other options as the library takes them."""
    options = dict(given)
    modules = options.pop("modules")
    if is_mapping(modules):
        modules = {whole_of("modules", taxel, "ids of taxels"): str(module) for taxel, module in modules.items()}
    for name, known in (("fit_probe", PROBE), ("fit_standoff", STANDOFF), ("fit_joints", JOINTS)):
        value = options[name]
        options[name] = (known if value else None) if isinstance(value, bool) or value is None else value
    return modules, options


calibrate.__module__ = "dermatome"
