"""The bodies of a drawn skin where touches place them."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dermatome._arguments import path_of
from dermatome._dermatome import Skin, write_taxels_of_bodies
from dermatome._errors import DataError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
        The same as vectors, in m and rad.
    sigma, sigma_turned : float or None
        Standard deviations of both, in m and rad; None: it does not move.
    chi2, p : float or None
        The test of its motion against its tolerance, without a unit; None without a contact.
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


@dataclass(frozen=True, repr=False)
class JointOffset:
    """The offset of a joint from its values.

    Attributes
    ----------
    name : str
        The joint.
    slides : bool
        Whether it slides; else it turns.
    offset, sigma : float
        What is to be added to its values, and its standard deviation, in rad, or in m if it slides.
    """

    name: str
    slides: bool
    offset: float
    sigma: float

    def __repr__(self) -> str:
        scale, unit = (1e3, "mm") if self.slides else (math.degrees(1.0), "degrees")
        return f"<dermatome.JointOffset: {self.name}, {scale * self.offset:.2f} +- {scale * self.sigma:.2f} {unit}>"


@dataclass(frozen=True, repr=False)
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

    def __repr__(self) -> str:
        return f"<dermatome.LevelScore: {self.level}, median {1e3 * self.median:.2f} mm, 90 % {1e3 * self.p90:.2f} mm>"


@dataclass(frozen=True, repr=False)
class HeldBack:
    """The prediction of contacts that were held back.

    Attributes
    ----------
    supported : {"mount", "patch", "module"}
        The last level that predicts contacts better than those before it.
    levels : tuple of LevelScore
        The score of each level.
    drawn : (float, float)
        Median distance of the touches from where the drawing predicts them, and the distance below which 90 % are, in m.
    explained : float
        Share of where the touches are that the fit explains, from 0 to 1: a wrong log has less than 0.85.
    """

    supported: str
    levels: tuple[LevelScore, ...]
    drawn: tuple[float, float]
    explained: float

    def __repr__(self) -> str:
        return f"<dermatome.HeldBack: the touches support the level {self.supported}>"


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
        Squared whitened errors of inliers and motions over their tolerances, without a unit; numbers that the inliers observe.
    noise, noise_over_stated : float
        Standard deviation of a touch per axis, in m, as it is estimated, and over what the observations state.
    side : float
        How readings fall along the normals of the fit as the sphere moves outwards, in standard deviations, without a unit: far below 0 for
        a mirrored drawing, 0 if the touches do not tell.
    faults : tuple of str
        Why the fit cannot be believed; empty if it can, or if there are too few contacts to judge it.
    probe : ProbeOffset or None
        The offset of the probe, if it is fitted.
    standoff, standoff_sigma : float or None
        Distance of touches from taxels along their normals, and its standard deviation, in m, if it is fitted.
    joints : tuple of JointOffset
        The offsets of the joints, if they are fitted.
    delay, delay_sigma : float or None
        How late the readings are next to the poses, and its standard deviation, in s; None without velocities of the contacts.
    delay_removed : float
        What of it was taken off, in s: all beyond five standard deviations.
    bodies : tuple of Body
        The mount, then the patches, then the modules.
    exchanged : tuple of (str, str)
        Modules that fit best in each other's place.
    turned : tuple of (str, float)
        Modules that fit best turned about their outward normal, and by which angle, in rad.
    untouched : tuple of str
        Modules without a touch: they keep their drawn pose on their patch.
    held_back : HeldBack or None
        The prediction of contacts that were held back; None if there are too few.
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
    noise: float
    noise_over_stated: float
    side: float
    faults: tuple[str, ...]
    probe: ProbeOffset | None
    standoff: float | None
    standoff_sigma: float | None
    joints: tuple[JointOffset, ...]
    delay: float | None
    delay_sigma: float | None
    delay_removed: float
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
        """Write the taxels to a table .csv, which is a drawing again, or the skin to another file, as .glb.

        Raises
        ------
        FileError
            If it cannot be written.
        DataError
            If the extension is unknown.
        """
        if path_of("path", path).lower().endswith(".csv"):
            columns = (of.tolist() for of in (self.ids, self.positions, self.normals, self.covariances))
            write_taxels_of_bodies(path, list(zip(*columns, self.modules, self.patches)))
        else:
            self.skin().write(path)

    def __repr__(self) -> str:
        ending = "converged" if self.converged else "not converged"
        counts = f"{len(self.ids)} taxels, {len(self.bodies)} bodies, {self.touches} touches, {self.contacts} contacts"
        return f"<dermatome.BodyCalibration: {counts}, {ending}>"


def bodies_of(found: dict[str, Any]) -> BodyCalibration:
    """A calibration of what the library found."""
    held_back = found["held_back"]
    made: dict[str, Any] = {
        **found,
        "modules": tuple(found["modules"]),
        "patches": tuple(found["patches"]),
        "probe": None if found["probe"] is None else ProbeOffset(*found["probe"]),
        "joints": tuple(JointOffset(*joint) for joint in found["joints"]),
        "bodies": tuple(Body(**body) for body in found["bodies"]),
        "exchanged": tuple(tuple(pair) for pair in found["exchanged"]),
        "turned": tuple(tuple(pair) for pair in found["turned"]),
        "untouched": tuple(found["untouched"]),
        "faults": tuple(found["faults"]),
        "held_back": None if held_back is None else HeldBack(
            held_back[0], tuple(LevelScore(*score) for score in held_back[1]), tuple(held_back[2]), held_back[3]
        ),
        "remarks": tuple(found["remarks"]),
        "_skin": found["skin"],
    }
    del made["skin"]
    return BodyCalibration(**made)


for _each in (Body, ProbeOffset, JointOffset, LevelScore, HeldBack, BodyCalibration):
    _each.__module__ = "dermatome"
