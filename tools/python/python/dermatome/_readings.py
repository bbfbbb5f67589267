"""Recordings of readings as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dermatome._dermatome import (
    Map,
    Skin,
    as_floats,
    as_numbers,
    condition_readings,
    is_extensive,
    join_readings,
    read_readings,
    simulate_touch,
)
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
    measured : (T, C, N) bool array or None
        Which values were measured and not filled; None: all that are finite.
    """

    values: NDArray[np.float64]
    ids: NDArray[np.uint32] | None
    timestamps: NDArray[np.float64]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    # No default on the class: the attributes are documented by it.
    measured: NDArray[np.bool_] | None = field(default_factory=lambda: None)

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

    @property
    def extensive(self) -> tuple[bool, ...]:
        """tuple of bool: Which channels are amounts, as forces in N, and not averages, as pressures."""
        return tuple(is_extensive(name, unit) for name, unit in zip(self.channels, self.units))

    def condition(
        self,
        map: Map,
        *,
        baseline: int = 0,
        gain: dict[int, float] | None = None,
        clip: tuple[float, float] | None = None,
        split: float | None = None,
        rate: float | None = None,
        fill: str = "none",
    ) -> Readings:
        """Make readings of the taxels of a map comparable, in the order of the arguments.

        Parameters
        ----------
        map : Map
            The map in whose order they are.
        baseline : int
            The mean of this many first frames is subtracted.
        gain : dict of int to float, optional
            What the readings of a taxel are multiplied by, by its id; 1 for others.
        clip : (2,) tuple of float, optional
            Bounds to which readings are clipped.
        split : float, optional
            Frequency, in Hz, that splits each channel into `NAME.slow` and `NAME.fast`. Needs times.
        rate : float, optional
            Frames per second, for readings without times.
        fill : {"none", "neighbours"}
            What takes the place of missing readings: the weighted mean of the taxels around each, within their
            range. `measured` says which readings are not filled.

        Returns
        -------
        Readings
            NaN where a reading has no baseline or is beyond 32-bit numbers.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> readings.condition(palm, baseline=10, split=5.0).channels
        ('force.slow', 'force.fast')
        """
        import numpy as np

        readings = self.on(map)
        times = readings.timestamps
        if rate is not None and not np.isfinite(times).any():
            if not 0 < rate < float("inf"):
                raise DataError(f"rate: found {rate}; needed: a number above 0")
            times = np.arange(len(times)) / rate
        if split is not None and not np.isfinite(times).all():
            raise DataError("split: found readings without times; needed: rate")
        gains = list((gain or {}).items())
        given = (map, readings.values, times, list(self.channels), baseline, gains, clip, split)
        values, names = condition_readings(*given)
        units = self.units if split is None else tuple(unit for unit in self.units for _ in range(2))
        measured = np.isfinite(values)
        if fill != "none":
            values, names = condition_readings(*given, fill)
        return Readings(values, None, times, tuple(names), units, measured if fill != "none" else None)

    def features(self, map: Map, level: int = 1) -> dict[str, dict[str, Any]]:
        """What a LeRobot dataset keeps of these readings, as `dermatome render` describes it in `features.json`.

        Parameters
        ----------
        map : Map
            The map in whose order they are.
        level : int
            The level whose values are kept.

        Returns
        -------
        dict
            For each patch that reaches up to the level its `dtype`, `shape` and `names`, and `values` (T, C n) float32:
            the values of its fields, channel by channel, 0 where there is none; `valid` (T, n) bool says
            which were measured.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> {key: feature["shape"] for key, feature in readings.features(palm, level=0).items()}
        {'observation.tactile.skin.L0': (81,)}
        """
        import numpy as np

        from dermatome.lerobot import key

        def pool(values: Any) -> Any:
            pooled = [map.pool(values[:, k : k + 1], level, extensive=extensive) for k, extensive in enumerate(self.extensive)]
            return np.concatenate(pooled, axis=1) if pooled else map.pool(values, level)

        values = self.on(map).values
        pooled = pool(values)
        measured = pooled if self.measured is None else pool(np.where(self.measured, values, np.nan))
        made, first = {}, 0
        for name, patch in map.patches.items():
            if level < len(patch.levels):
                part = pooled[:, :, first : first + len(patch.levels[level].positions)]
                valid = np.isfinite(measured[:, :, first : first + part.shape[2]]).all(axis=1)
                first += part.shape[2]
                known = np.isfinite(part)
                shape = (part.shape[1] * part.shape[2],)
                made[key(name, level)] = {
                    "dtype": "float32",
                    "shape": shape,
                    "names": None,
                    "values": np.where(known, part, np.float32(0)).reshape(len(part), *shape),
                    "valid": valid,
                }
        return made

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
