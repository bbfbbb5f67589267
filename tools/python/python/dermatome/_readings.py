"""Recordings of readings as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dermatome._dermatome import Map, Skin, as_floats, as_numbers, join_readings, read_readings, simulate_touch
from dermatome._errors import DataError

if TYPE_CHECKING:
    import os

    import numpy as np
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Readings:
    """A recording.

    Attributes
    ----------
    values : (T, C, N) float64 array
        The readings, NaN where there is none.
    ids : (N,) uint32 array or None
        Ids of the taxels; None: they are in the order of the map.
    timestamps : (T,) float64 array
        When each frame was taken, in s; NaN where that is not known.
    channels, units : tuple of str
        Names and units of the channels.
    """

    values: NDArray[np.float64]
    ids: NDArray[np.uint32] | None
    timestamps: NDArray[np.float64]
    channels: tuple[str, ...]
    units: tuple[str, ...]

    @staticmethod
    def read(
        path: str | os.PathLike[str],
        map: Map | None = None,
        *,
        layout: Any = "tnc",
        channels: tuple[str, ...] | None = None,
        units: tuple[str, ...] | None = None,
    ) -> Readings:
        """Read a recording.

        Parameters
        ----------
        path : str or os.PathLike
            .txt, .csv, .npy or .npz.
        map : Map, optional
            The map whose taxels the readings are put to, by their ids.
        layout : {"tnc", "tcn"}
            The axes of an array of three: frames, then taxels or channels.
        channels, units : tuple of str, optional
            Names and units of the channels, of a .npy, which has none, or instead of those of the file.

        Returns
        -------
        Readings
        """
        readings = _of(read_readings(path, layout))
        if channels is not None or units is not None:
            names, of_unit = channels or readings.channels, units or readings.units
            readings = Readings.from_arrays(
                readings.values, ids=readings.ids, timestamps=readings.timestamps, channels=names, units=of_unit
            )
        return readings if map is None else readings.on(map)

    @staticmethod
    def from_arrays(
        values: ArrayLike,
        *,
        ids: ArrayLike | None = None,
        timestamps: ArrayLike | None = None,
        channels: tuple[str, ...] | None = None,
        units: tuple[str, ...] | None = None,
    ) -> Readings:
        """Make a recording of arrays: values are (T, N) or (T, C, N).

        Examples
        --------
        >>> import dermatome
        >>> dermatome.Readings.from_arrays([[1, 2, 3], [4, 5, 6]]).values.shape
        (2, 1, 3)
        """
        import numpy as np

        array = as_floats("values", values)
        if array.ndim == 2:
            array = array[:, None, :]
        if array.ndim != 3:
            raise DataError(f"values: found shape {array.shape}; needed: shape (T, N) or (T, C, N)")
        frames, count, taxels = array.shape

        def fits(name: str, given: Any, needed: int) -> None:
            if len(given) != needed:
                raise DataError(f"{name}: found {len(given)}; needed: {needed}")

        numbers = None if ids is None else as_numbers("ids", ids, taxels)
        times = np.full(frames, np.nan) if timestamps is None else as_floats("timestamps", timestamps).ravel()
        names = tuple(f"channel{k}" for k in range(count)) if channels is None else tuple(channels)
        of_unit = ("",) * count if units is None else tuple(units)
        fits("timestamps", times, frames)
        fits("channels", names, count)
        fits("units", of_unit, count)
        return Readings(array, numbers, times, names, of_unit)

    def on(self, map: Map) -> Readings:
        """The same readings in the order of a map, by their ids; taxels without one have NaN."""
        if self.ids is None:
            if self.values.shape[2] != map.n_taxels:
                raise DataError(f"map: found {map.n_taxels} taxels; needed: {self.values.shape[2]}, or readings with ids")
            return self
        values = join_readings(map, self.values, self.ids)
        return Readings(values, None, self.timestamps, self.channels, self.units)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the recording to an .npz file that `read` and the command read with the layout "tcn"."""
        import numpy as np

        arrays: dict[str, Any] = {"values": self.values, "channels": np.array(self.channels), "units": np.array(self.units)}
        if self.ids is not None:
            arrays["ids"] = self.ids
        if np.isfinite(self.timestamps).all():
            arrays["timestamps"] = self.timestamps
        np.savez(path, **arrays)


def _of(arrays: dict[str, Any]) -> Readings:
    return Readings(
        arrays["values"], arrays["ids"], arrays["timestamps"], tuple(arrays["channels"]), tuple(arrays["units"])
    )


def touch(skin: Skin | Map, **options: Any) -> tuple[Readings, dict[str, Any]]:
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

    Examples
    --------
    >>> import dermatome
    >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(20) for x in range(20)])
    >>> readings, truth = dermatome.touch(palm, presses=2)
    >>> readings.values.shape[1:], readings.units, int(max(truth["press"])) + 1
    ((1, 400), ('N',), 2)
    """
    arrays = simulate_touch(skin, **options)
    return _of(arrays), arrays["truth"]


for _public in (Readings, touch):
    _public.__module__ = "dermatome"
