"""Calibration touch by touch."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from dermatome._arguments import whole_of
from dermatome._bodies import BodyCalibration, bodies_of
from dermatome._calibrate import check_options, options_of, options_of_bodies
from dermatome._dermatome import Calibration, Map, Observations, Skin, TouchFollower, TouchLines
from dermatome._errors import ArgumentError, DataError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    _Path = str | os.PathLike[str]
    _Unit = Literal["m", "mm", "cm", "in"] | float


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
        Length of the whitened innovation, without a unit; None: nothing that it measures was known, or the bodies of a drawing are fitted.
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

    def __init__(self, rows: Iterator[Any], follower: TouchFollower, unit: Any) -> None:
        self.remarks: list[str] = []
        self._rows, self._follower, self._unit = rows, follower, unit
        self._lines: TouchLines | None = None
        self._result: Calibration | BodyCalibration | None = None

    def __iter__(self) -> Following:
        return self

    def __next__(self) -> FollowedTouch:
        observations, time = self._observed()
        for remark in self._follower.remarks_of(observations):
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
            self._result = bodies_of(found) if isinstance(found, dict) else found
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
        times: Any = ()
        if hasattr(row, "keys") and "time" in row.keys():
            import numpy as np

            times = np.ravel(row["time"])
        return Observations.from_columns(row, unit=self._unit), float(times[-1]) if len(times) else None

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


def follow(
    rows: Iterable[str] | Iterable[Observations] | Iterable[Mapping[str, ArrayLike]],
    *,
    every: int = 1,
    unit: _Unit | None = None,
    robust: Literal["auto", "none", "huber", "tukey", "gnc"] = "auto",
    covariances: bool = True,
    cad: Skin | Map | _Path | None = None,
    modules: Mapping[int, str] | _Path | None = None,
    level: Literal["mount", "patch", "module"] = "module",
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
        Number of touches between solves.
    unit : {"m", "mm", "cm", "in"} or float
        Unit of all lengths in lines and columns.
    robust, covariances
        As of `calibrate`.
    cad, modules, level, mount, mount_angle, patch, patch_angle, module, module_angle, fit_probe, fit_standoff, fit_joints, as_drawn
        As of `calibrate`.
    threads : int
        0 for one per processor.

    Returns
    -------
    Following

    Raises
    ------
    DataError
        If an option is unknown or out of its range, or, while it runs, a row cannot be used or touches a taxel that
        the drawing does not have.

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
    taxels, bodies = options_of(locals())
    check_options(cad, taxels, bodies)
    every = whole_of("every", every, "a number of touches")
    if every < 1:
        raise DataError(f"every: found {every}; needed: a number of touches, at least 1")
    kind, lines = type(rows), None
    with contextlib.suppress(TypeError):
        lines = None if issubclass(kind, (str, bytes, Mapping, Observations)) else iter(rows)
    if lines is None:
        raise ArgumentError(f"rows: found {kind.__name__}; needed: an iterable of lines or of touches")
    if cad is None:
        return Following(lines, TouchFollower.of_taxels(taxels, every, threads), unit)
    return Following(lines, TouchFollower.of_bodies(cad, *options_of_bodies(bodies), every, threads), unit)


for _each in (FollowedTouch, Following, follow):
    _each.__module__ = "dermatome"
