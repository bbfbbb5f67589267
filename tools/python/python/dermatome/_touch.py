"""Simulated recordings."""

from __future__ import annotations

from typing import Any

from dermatome._dermatome import Map, Skin, simulate_touch
from dermatome._readings import Readings, of_arrays


def touch(
    skin: Skin | Map,
    *,
    presses: int = 5,
    touches: int = 1,
    radius: float = 0.015,
    depth: float = 0.002,
    stiffness: float = 2e7,
    roll: float = 0.02,
    duration: float = 1.0,
    pause: float = 0.25,
    rate: float = 100.0,
    taxel_radius: float = 0.002,
    extensive: bool = True,
    noise: float = 0.0,
    drift: float = 0.0,
    dead: float = 0.0,
    seed: int = 0,
) -> tuple[Readings, dict[str, Any]]:
    """Simulate a recording of a sphere that presses and rolls on a skin.

    Parameters
    ----------
    skin : Skin or Map
        What is touched.
    presses, touches : int
        Number of presses, one after the other (5), and of spheres that press at once (1).
    radius, depth, roll : float
        Radius of the sphere (0.015), how deep it is pressed in (0.002) and how far it rolls (0.02), in m.
    stiffness : float
        Pressure over depth, in Pa/m (2e7).
    duration, pause : float
        How long a press takes (1) and nothing is touched before and after it (0.25), in s.
    rate : float
        Frames per second (100).
    taxel_radius : float
        Radius of the disc on which a taxel feels, in m (0.002).
    extensive : bool
        Whether taxels read the force on their disc, in N (the default), or the mean pressure, in Pa.
    noise, drift : float
        Standard deviations of the pressure, in Pa, and of its growth, in Pa/s (0).
    dead : float
        Share of the taxels that read NaN (0).
    seed : int
        Seed of everything that is drawn at random (0).

    Returns
    -------
    readings : Readings
    truth : dict
        Of each touch its `frame`, `time`, `press`, `patch`, `sphere`, `centre` (m, frame of the link), `force` (N) and
        `taxels`.

    Raises
    ------
    DataError
        If a number is out of its range.

    Examples
    --------
    >>> import dermatome
    >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(20) for x in range(20)])
    >>> readings, truth = dermatome.touch(palm, presses=2)
    >>> readings.values.shape[1:], readings.units, int(max(truth["press"])) + 1
    ((1, 400), ('N',), 2)
    """
    arrays = simulate_touch(
        skin,
        presses=presses,
        touches=touches,
        radius=radius,
        depth=depth,
        stiffness=stiffness,
        roll=roll,
        duration=duration,
        pause=pause,
        rate=rate,
        taxel_radius=taxel_radius,
        extensive=extensive,
        noise=noise,
        drift=drift,
        dead=dead,
        seed=seed,
    )
    return of_arrays(arrays), arrays["truth"]


touch.__module__ = "dermatome"
