"""Recordings of readings as arrays."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from dermatome import _conditioning
from dermatome._arguments import A_MAP, array_of, check_kind, one_of, path_of, whole_of, words_of
from dermatome._dermatome import (
    Map, as_floats, as_numbers, is_extensive, is_same_unit, join_readings, main_channel, read_readings, summarise_readings,
)
from dermatome._errors import ArgumentError, DataError
from dermatome._rest import flags_of, rested, stand_still
from dermatome._whole import written

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from dermatome._dermatome import Layout, Response
    from dermatome._recording import Recording

# Times beyond 3170 years are not in s: the command refuses them too.
LATEST = 1e11


@dataclass(frozen=True, eq=False, repr=False)
class Readings:
    """A recording.

    `len(readings)` is the number of frames, `readings[10:50]` are some of them.

    Attributes
    ----------
    values : (T, C, N) float64 array
        The readings, NaN where there is none; of a `Recording` they are float32 where that is exact.
    ids : (N,) uint32 array or None
        Ids of the taxels; None: they are in the order of the map.
    timestamps : (T,) float64 array
        When each frame was taken, in s; NaN where that is not known.
    channels, units : tuple of str
        Names and units of the channels.
    measured : (T, C, N) bool array or None
        Which values were measured and not filled; None: all that are finite.
    episode : int or None
        The number of the episode of a `Recording` whose chunk this is.
    episodes : (T,) int64 array or None
        The number of the episode of each frame, where there are several: each has times, zeros, thresholds and contacts of its
        own.
    is_tared : bool
        Whether readings of all channels that measure touches are about 0 where nothing touches: the zero of a pressure or force is
        stated, or one is subtracted.
    tared : tuple of bool or None
        Which channels are, where some that measure touches are and others are not; None: as `is_tared` says.
    kinds : tuple of str or None
        What each channel measures, "touch", "tangential" or "other"; None: as name and unit tell.
    threshold : float or None
        The reading above which a taxel is loaded, as the file states it, in the unit of the readings.
    remarks : tuple of str
        What was noticed when the readings were read, put on a map and conditioned, as the command prints it.
    """

    values: NDArray[np.floating[Any]]
    ids: NDArray[np.uint32] | None
    timestamps: NDArray[np.float64]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    # No defaults on the class: the attributes are documented by it.
    measured: NDArray[np.bool_] | None = field(default_factory=lambda: None)
    remarks: tuple[str, ...] = field(default_factory=tuple)
    episode: int | None = field(default_factory=lambda: None)
    is_tared: bool = field(default_factory=lambda: False)
    threshold: float | None = field(default_factory=lambda: None)
    episodes: NDArray[np.int64] | None = field(default_factory=lambda: None)
    kinds: tuple[str, ...] | None = field(default_factory=lambda: None)
    tared: tuple[bool, ...] | None = field(default_factory=lambda: None)

    @staticmethod
    def read(
        path: str | os.PathLike[str],
        map: Map | None = None,
        *,
        layout: Literal["tnc", "tcn"] | None = None,
        channels: str | Sequence[str] | None = None,
        units: str | Sequence[str] | None = None,
    ) -> Readings:
        """Read a recording.

        Parameters
        ----------
        path : str or os.PathLike
            .txt, .csv, .npy or .npz.
        map : Map, optional
            The map whose taxels the readings are put to, by their ids.
        layout : {"tnc", "tcn"}, optional
            The axes of an array of three: frames, then taxels or channels. By default what the array `layout` of a .npz
            says, which `write` puts there, else "tnc".
        channels, units : str or sequence of str, optional
            Names of the channels instead of those of the file; units where it states none, as a .npy: two that differ are an error.

        Returns
        -------
        Readings

        Raises
        ------
        MissingFileError, FileError
            If it does not exist, or cannot be read.
        DataError
            If it is no recording, the layout or the number of names is another, a unit is not that of the file, or an id is of no
            taxel of the map.
        """
        layout = None if layout is None else one_of("layout", layout, ("tnc", "tcn"))  # type: ignore[assignment]
        stored, measured = _stored(path_of("path", path))
        arrays = read_readings(path, stored or layout or "tnc")
        remarks: list[str] = []
        if stored and layout not in (None, stored) and arrays["values"].shape[1] > 1:
            remarks.append(f"the layout is {stored!r}, as the file says, and not {layout!r}")
        readings = of_arrays(arrays)
        if measured is not None and measured.shape == readings.values.shape:
            readings = replace(readings, measured=measured)
        if not _any_finite(readings.timestamps):
            remarks.append("the frames have no times; condition(rate=) gives them some")
        elif stand_still(readings.timestamps):
            remarks.append("no frame is later than the first; condition(rate=) gives the frames times")
        count = len(readings.channels)
        given = readings.units if units is None else names_of("units", units, count)
        for name, known, unit in zip(readings.channels, readings.units, given):
            if known and unit and not is_same_unit(known, unit):
                raise DataError(f"units: found {unit!r} for {name!r}, which is in {known!r} as {path} says; needed: one unit; condition(scale=, units=) converts")
        readings = replace(
            readings,
            channels=readings.channels if channels is None else names_of("channels", channels, count),
            kinds=readings.kinds if channels is None else None,
            units=given,
            threshold=readings.threshold if given == readings.units else None,
            remarks=tuple(remarks),
        )
        return readings if map is None else readings.on(map)

    @staticmethod
    def open(
        path: str | os.PathLike[str],
        *,
        stream: str | None = None,
        layout: Layout | str | os.PathLike[str] | Mapping[str, Any] | None = None,
        episode: int | None = None,
    ) -> Recording:
        """Open a recording of any program, and read nothing but what is in it.

        Parameters
        ----------
        path : str or os.PathLike
            What `read` reads, text of Tekscan, novel, XSENSOR, Stappone, XELA and YARP, a Zarr of Open-X-Tactile (folder
            or zip), a LeRobot dataset, HDF5, a bag of ROS or MCAP. Zarr, LeRobot, HDF5 and bags need the extras `zarr`,
            `parquet`, `hdf5`, `ros` of the package.
        stream : str, optional
            What is read, where there is more than one: a name of `Recording.streams`, or a pattern for one array of each
            episode, as `data/*/pressure`. By default that of the layout, or the only one.
        layout : Layout, str, os.PathLike or mapping, optional
            What the file does not say: axes, time, unit, sign, zero, taxels. Or "tnc", "tcn", as for `read`.
        episode : int, optional
            The episode that is read; by default all, one after the other.

        Returns
        -------
        Recording

        Raises
        ------
        MissingFileError, FileError
            If it does not exist, or cannot be read.
        ImportError
            If what reads this kind of file is not installed.
        DataError
            If it is no recording that can be read, or has no such stream or episode.
        """
        from dermatome._recording import Recording

        return Recording(Readings, path_of("path", path), stream, layout, episode)

    @staticmethod
    def from_arrays(
        values: ArrayLike,
        *,
        ids: ArrayLike | None = None,
        timestamps: ArrayLike | None = None,
        channels: str | Sequence[str] | None = None,
        units: str | Sequence[str] | None = None,
    ) -> Readings:
        """Make a recording of arrays; values are (T, N) or (T, C, N), timestamps (T,) in s or of `datetime64`.

        Raises
        ------
        DataError
            If shapes do not fit each other, or times are not in s.

        Examples
        --------
        >>> import dermatome
        >>> dermatome.Readings.from_arrays([[1, 2, 3], [4, 5, 6]], units="N")
        <Readings: 2 frames, 1 channel (channel0, N), 3 taxels>
        """
        array = as_floats("values", values)
        if array.ndim == 2:
            array = array[:, None, :]
        if array.ndim != 3:
            raise DataError(f"values: found shape {array.shape}; needed: shape (T, N) or (T, C, N)")
        frames, count, taxels = array.shape
        return Readings(
            array,
            None if ids is None else as_numbers("ids", ids, taxels),
            _times(timestamps, frames),
            tuple(f"channel{k}" for k in range(count)) if channels is None else names_of("channels", channels, count),
            ("",) * count if units is None else names_of("units", units, count),
        )

    @staticmethod
    def from_xarray(array: Any) -> Readings:
        """Make a recording of an `xarray.DataArray` of the axes time and taxel, and channel if there are several.

        Coordinates of these names are times, ids and names of channels, `unit` or the attribute `units` are units,
        `measured` says which values were measured, and the attributes `is_tared` and `threshold` what is known where nothing
        touches, as `to_xarray` makes them.

        Raises
        ------
        DataError
            If it has other axes, or a coordinate does not fit.
        """
        from dermatome._frames import from_xarray

        return from_xarray(Readings.from_arrays, array)

    @staticmethod
    def from_pandas(table: Any, *, units: str | None = None) -> Readings:
        """Make a recording of a `pandas.DataFrame`: a row a frame, a column a taxel, whose name is its id.

        An index of numbers is times in s, of dates or durations what they say; a table that only counts its rows has no times.

        Raises
        ------
        DataError
            If a column is no id, or the index is no time.

        Examples
        --------
        >>> import dermatome, pandas
        >>> table = pandas.DataFrame([[1.0, 2.0], [3.0, 4.0]], index=[0.0, 0.1], columns=[7, 8])
        >>> dermatome.Readings.from_pandas(table, units="N")
        <Readings: 2 frames, 1 channel (channel0, N), 2 taxels, 0.1 s>
        """
        from dermatome._frames import from_pandas

        return from_pandas(Readings.from_arrays, table, units)

    def with_values(self, values: ArrayLike, *, units: str | Sequence[str] | None = None) -> Readings:
        """The same frames, channels and taxels with other values, (T, C, N), or (T, N) with one channel.

        Raises
        ------
        DataError
            If they have another shape.
        """
        array: Any = as_floats("values", values)
        shape = self.values.shape
        if array.shape not in (shape, (shape[0], shape[2]) if shape[1] == 1 else shape):
            raise DataError(f"values: found shape {array.shape}; needed: {shape}")
        names = self.units if units is None else names_of("units", units, shape[1])
        return replace(self, values=array.reshape(shape), units=names, measured=None, threshold=None if units else self.threshold)

    def select(self, channels: str | Sequence[str]) -> Readings:
        """Some channels, by their names, in this order.

        Raises
        ------
        DataError
            If there is no such channel.
        """
        names = words_of("channels", channels, f"some of {list(self.channels)}")
        missing = [name for name in names if name not in self.channels]
        if missing or not names:
            raise DataError(f"channels: found {missing[0] if missing else 'none'!r}; needed: some of {list(self.channels)}")
        twice = [name for name in names if self.channels.count(name) > 1]
        if twice:
            at = [k for k, name in enumerate(self.channels) if name == twice[0]]
            raise DataError(f"channels: found several of the name {twice[0]!r}: {at}; needed: other names; dataclasses.replace(readings, channels=...) gives them")
        chosen = [self.channels.index(name) for name in names]
        measured = None if self.measured is None else self.measured[:, chosen]
        units = tuple(self.units[k] for k in chosen) if self.units else ()
        kinds = None if self.kinds is None else tuple(self.kinds[k] for k in chosen)
        made = replace(self, values=self.values[:, chosen], channels=names, units=units, measured=measured, kinds=kinds)
        if self.tared is not None:
            made = rested(made, [self.tared[k] for k in chosen])
        # It is of one channel.
        return made if self.threshold is None or chosen[_main(made)] == _main(self) else replace(made, threshold=None)

    def drop(self, ids: ArrayLike) -> Readings:
        """The recording without the readings of these taxels, which are NaN: of faulty ones, or to see what depends on them.

        Parameters
        ----------
        ids : (k,) array_like of int
            Their ids, or their places in the order of the map if the recording has no ids; or an (N,) mask of bool.

        Raises
        ------
        DataError
            If there is no such taxel, or the mask has another length.
        """
        import numpy as np

        known: Any = range(self.values.shape[2]) if self.ids is None else self.ids
        gone = array_of("ids", ids, f"{'places' if self.ids is None else 'ids'} of taxels").ravel()
        if gone.dtype.kind == "b":
            if gone.shape != (self.values.shape[2],):
                raise DataError(f"ids: found a mask of shape {gone.shape}; needed: ({self.values.shape[2]},)")
            gone = np.asarray(known)[gone]
        missing = ~np.isin(gone, known)
        if missing.any():
            raise DataError(f"ids: found {gone[missing][0]}; needed: {'places' if self.ids is None else 'ids'} of taxels of the recording")
        is_gone = np.isin(known, gone)
        measured = None if self.measured is None else self.measured & ~is_gone
        return replace(self, values=np.where(is_gone, np.nan, self.values), measured=measured)

    def crop(self, begin: float | None = None, end: float | None = None) -> Readings:
        """The frames from `begin` to before `end`, in s of `timestamps`.

        Raises
        ------
        DataError
            If frames have no times, or none is between them.
        """
        from dermatome._frames import crop

        return crop(self, begin, end)

    def resample(self, rate: float) -> Readings:
        """The recording with `rate` frames per second: the mean of the frames around each new one, or what lies between two.

        Between frames further apart than 2.5 of their median step there is nothing: NaN. Each episode is one of its own.

        Raises
        ------
        DataError
            If the rate is no number above 0, or times do not increase.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1, rate=50.0)
        >>> len(readings), len(readings.resample(25.0))
        (75, 38)
        """
        from dermatome._frames import resample

        return resample(self, rate)

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[Readings]:
        return (self[frame] for frame in range(len(self)))

    def __getitem__(self, frames: Any) -> Readings:
        if isinstance(frames, tuple):
            raise DataError("frames: found several indices; needed: one, of frames; values[...] are numbers")
        chosen: Any = frames
        if not isinstance(frames, slice):
            chosen = frames_of(frames, len(self))
        measured = None if self.measured is None else self.measured[chosen]
        episodes = None if self.episodes is None else self.episodes[chosen]
        return replace(self, values=self.values[chosen], timestamps=self.timestamps[chosen], measured=measured, episodes=episodes)

    def by_episode(self) -> list[Readings]:
        """The recording of each episode, in order."""
        import numpy as np

        if self.episodes is None:
            return [self]
        if not len(self):
            return [replace(self, episodes=None)]
        begins = np.flatnonzero(np.diff(self.episodes)) + 1
        bounds = [0, *begins.tolist(), len(self)]
        parts = [self[first:end] for first, end in zip(bounds, bounds[1:])]
        return [replace(part, episodes=None, episode=int(self.episodes[first])) for part, first in zip(parts, bounds)]

    def __repr__(self) -> str:
        frames, count, taxels = self.values.shape
        shown = [", ".join(filter(None, pair)) for pair in zip(self.channels[:4], self.units)]
        named = "; ".join(each for each in shown if each) + ("; ..." if count > 4 else "")
        text = f"{_count(frames, 'frame')}, {_count(count, 'channel')}" + (f" ({named})" if named else "")
        text += f", {_count(taxels, 'taxel')}"
        if len(self.timestamps) > 1 and _any_finite(self.timestamps):
            import numpy as np

            text += f", {np.nanmax(self.timestamps) - np.nanmin(self.timestamps):.6g} s"
        return f"<Readings: {text}>"

    def on(self, map: Map) -> Readings:
        """The same readings in the order of a map, by their ids; taxels without one have NaN.

        Columns of no taxel are left out, and `remarks` says so.

        Raises
        ------
        DataError
            If readings without ids are not of as many taxels as the map has, or an id is of no taxel.
        """
        check_kind("map", map, Map, A_MAP)
        if self.ids is None:
            if self.values.shape[2] != map.n_taxels:
                raise DataError(f"readings: found {self.values.shape[2]} columns without ids; needed: {map.n_taxels}, one for each taxel of the map, or ids")
            return self
        values, said = join_readings(map, self.values, self.ids, self.channels, self.units)
        measured = self.measured
        if measured is not None:
            measured = join_readings(map, measured.astype(float), self.ids, self.channels, self.units)[0] == 1
        return replace(self, values=values, ids=None, measured=measured, remarks=(*self.remarks, *said))

    @property
    def extensive(self) -> tuple[bool, ...]:
        """tuple of bool: Which channels are amounts, as forces in N, and not averages, as pressures."""
        return tuple(is_extensive(name, unit) for name, unit in zip(self.channels, self.units))

    def modalities(self, map: Map) -> tuple[str | None, ...]:
        """Of which modality besides touch each channel is, as "thermal", of those whose sensors a map has; else None.

        Raises
        ------
        DataError
            If a unit is not known.
        """
        check_kind("map", map, Map, A_MAP)
        return tuple(map.modality(name, unit) for name, unit in zip(self.channels, self.units))

    def condition(
        self,
        map: Map,
        *,
        scale: ArrayLike = 1.0,
        offset: ArrayLike = 0.0,
        baseline: ArrayLike = 0,
        zero: Literal["follow", "stored"] | float | Sequence[float] | Sequence[Sequence[float]] | NDArray[Any] | None = None,
        gain: Mapping[int, float] | ArrayLike | None = None,
        response: Response | None = None,
        clip: Sequence[float] | None = None,
        split: float | None = None,
        rate: float | None = None,
        fill: str = "none",
        units: str | Sequence[str] | None = None,
    ) -> Readings:
        """Make readings of the taxels of a map comparable, in the order of the arguments.

        Parameters
        ----------
        map : Map
            The map in whose order they are.
        scale, offset : float, (N,) or (C, N) array_like
            What readings are multiplied by and what is then added to them, as from counts to Pa.
        baseline : int, (N,) or (C, N) array_like
            What is subtracted; a number: the mean of this many first frames. Of channels that measure touches, as zero and gain;
            arrays (C, N) have numbers for all channels.
        zero : "follow", "stored" or float, (N,) or (C, N) array_like, optional
            Instead of a baseline: the zero of each taxel is followed where nothing touches, is that of `response`, or is
            known.
        gain : (N,) or (C, N) array_like, or dict of int to float, optional
            What the readings of a taxel are multiplied by; in a dict by its id, and 1 for others.
        response : Response, optional
            Turns readings into pressures, and masks faulty taxels and those without a gain.
        clip : (2,) sequence of float, optional
            Bounds to which readings are clipped, in their unit.
        split : float, optional
            Frequency, in Hz, that splits each channel into `NAME.slow` and `NAME.fast`. Needs times.
        rate : float, optional
            Frames per second, for readings without times.
        fill : {"none", "neighbours"}
            What takes the place of missing readings: the weighted mean of the taxels around each, within their
            range. `measured` says which readings are not filled.
        units : str or sequence of str, optional
            Units of the channels from here on; by default as before.

        Returns
        -------
        Readings
            NaN where a reading has no baseline or is beyond 32-bit numbers; `remarks` says how many.

        Raises
        ------
        DataError
            If a shape is another, an option is unknown or out of its range, or times are needed and missing.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> readings.condition(palm, baseline=10, split=5.0).channels
        ('force.slow', 'force.fast')
        >>> readings.condition(palm, scale=1000.0, units="mN").units
        ('mN',)
        """
        readings = self if units is None else replace(self, units=names_of("units", units, len(self.channels)), threshold=None)
        options = _conditioning.Options(scale, offset, baseline, zero, gain, response, clip, split, rate, fill)
        return _conditioning.condition(readings, map, options)

    def features(self, map: Map, level: int | str = 1) -> dict[str, dict[str, Any]]:
        """What a LeRobot dataset keeps of these readings, as `dermatome render` describes it in `features.json`.

        Parameters
        ----------
        map : Map
            The map in whose order they are.
        level : int or str
            The level whose values are kept; a patch without it has those of its coarsest level. Or one of `Map.field_levels`, as
            "body.L1".

        Returns
        -------
        dict
            For each patch, or for the level without a mesh, its `dtype`, `shape` and `names`, and `values` (T, C n) float32:
            the values of its fields, channel by channel, 0 where there is none; `valid` (T, n) bool says
            which were measured.

        Raises
        ------
        DataError
            If readings are not of the map, or it has no such level.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> {key: feature["shape"] for key, feature in readings.features(palm, level=0).items()}
        {'observation.tactile.skin.L0': (81,)}
        """
        import numpy as np

        from dermatome._adapter import field_counts
        from dermatome.lerobot import keys

        of_map = self.on(map)
        pooled = of_map.pooled(map, level)
        measured = pooled
        if of_map.measured is not None:
            measured = replace(of_map, values=np.where(of_map.measured, of_map.values, np.nan)).pooled(map, level)
        # A channel of another modality than the level has no values there, and does not count.
        ever = [np.isfinite(map.pool(np.where(map._read(of), 0.0, np.nan), level, modality=of)).any() for of in self.modalities(map)]
        measured = measured[:, np.array(ever)] if any(ever) else measured
        made: dict[str, dict[str, Any]] = {}
        names = keys(map, level)
        for name, _, fields in field_counts(map, level):
            part: Any = pooled[:, :, fields]
            known, shape = np.isfinite(part), (part.shape[1] * part.shape[2],)
            values: Any = np.where(known, part, np.float32(0))
            made[names[name]] = {
                "dtype": "float32",
                "shape": shape,
                "names": None,
                "values": values.reshape(len(part), *shape),
                "valid": np.isfinite(measured[:, :, fields]).all(axis=1),
            }
        return made

    def pooled(self, map: Map, level: int | str, *, threads: int = 0) -> NDArray[np.float32]:
        """The values of the fields of a level, or of one of `Map.field_levels`, as "body.L1", (T, C, fields): sums of channels that
        are amounts, averages of others.

        Raises
        ------
        DataError
            If readings are not of the map, or it has no such level.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> sums = [readings.pooled(palm, level).sum(axis=2) for level in range(palm.n_levels)]
        >>> bool(abs(sums[0] - sums[-1]).max() < 1e-5)
        True
        """
        import numpy as np

        values = self.on(map).values
        if not self.channels:
            return map.pool(values, level)
        kinds = list(zip(range(len(self.channels)), self.extensive, self.modalities(map)))
        if isinstance(level, str):
            # Of a level of a modality readings of others are none.
            values = np.stack([np.where(map._read(of), values[:, k], np.nan) for k, _, of in kinds], axis=1)
        parts = [map.pool(values[:, k : k + 1], level, extensive=kind, modality=of, threads=threads) for k, kind, of in kinds]
        return np.concatenate(parts, axis=1)

    def summary(
        self,
        map: Map,
        *,
        channel: str | None = None,
        threshold: float | None = None,
        probe: Literal["any", "finger", "foot"] = "any",
        level: str | None = None,
        by: Literal["group", "step"] = "group",
    ) -> list[dict[str, Any]]:
        """The sums of a trial, as in pressure mapping: of the whole skin, its links, patches, named regions and contacts.

        Parameters
        ----------
        map : Map
            The map in whose order they are; `Map.with_regions` names regions.
        channel : str, optional
            The channel that is added up; by default the first that measures touches.
        threshold : float, optional
            A taxel is loaded above this, in the unit of the channel; 0: above 0. By default it is that of the file, if it
            states one. Else it is estimated from the first frames, in which nothing should touch the skin; unless
            readings are tared, the mean of these is subtracted.
        probe : {"any", "finger", "foot"}
            What touches the skin, for contacts that are close to each other; parts of one foot are one contact.
        level : str, optional
            A level of the whole body or of a modality, as "body.L1" or "arm.thermal.L0" (`Map.field_levels`), whose fields are
            groups, too.
        by : {"group", "step"}
            What a row is of: a group, or each loading of a patch or a region from begin to end, as the steps of a gait.

        Returns
        -------
        list of dict
            One for each group or step, with the columns of `dermatome summary`; None where something is not known. Of several
            episodes each has its rows, and their number is `episode`.

        Raises
        ------
        DataError
            If there is no such channel, its unit is unknown, or the noise cannot be estimated.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> whole, *others = readings.summary(palm, threshold=0)
        >>> whole["group"], whole["taxels"], whole["force_peak"] > 0
        ('whole', 81.0, True)
        """
        if len(parts := self.by_episode()) > 1:
            # Each has its own rows, as those of the command.
            how: Any = {"channel": channel, "threshold": threshold, "probe": probe, "level": level, "by": by}
            return [{"episode": part.episode, **row} for part in parts for row in part.summary(map, **how)]
        joined = self.on(map)
        names = joined.channels or ("",)
        channel = None if channel is None else one_of("channel", channel, names)
        main = _main(joined)
        if channel is not None and names.count(channel) > 1:
            raise DataError(f"channel: found several of the name {channel!r}; needed: other names; dataclasses.replace(readings, channels=...) gives them")
        number = main if channel is None else names.index(channel)
        unit = joined.units[number] if joined.units else ""
        rows, found, _ = summarise_readings(
            map,
            joined.values[:, number],
            joined.timestamps,
            names[number],
            unit,
            kind=None if joined.kinds is None else joined.kinds[number],
            threshold=threshold,
            is_tared=flags_of(joined)[number],
            stated=joined.threshold if number == main else None,
            probe=probe,
            level=level,
            by=by,
        )
        if found is None:
            raise DataError("threshold: found none, and the noise cannot be estimated from one frame; needed: a number")
        return rows

    def by_region(self, map: Map) -> NDArray[np.float32]:
        """The value of each named region of a map, (T, C, R): sums of channels that are amounts, averages of others.

        Averages are weighted by the areas of taxels; NaN where no taxel of a region has a reading.

        Raises
        ------
        DataError
            If readings are not of the map.
        """
        import numpy as np

        values = self.on(map).values
        kinds = enumerate(zip(self.extensive, self.modalities(map)))
        parts = [map.pool_regions(values[:, k], extensive=kind, modality=of) for k, (kind, of) in kinds]
        return np.stack(parts, axis=1)

    def by_area(self, map: Map, areas: Mapping[str, int] | ArrayLike | None = None) -> NDArray[np.float32]:
        """The value of each functional area of Open-X-Tactile, (T, C, 24): sums of channels that are amounts, averages of others.

        Parameters
        ----------
        map : Map
            The map in whose order they are.
        areas : mapping of str to int, or (N,) array_like of int, optional
            The area of each patch, or of each taxel of the map, -1 for none; `dermatome.recordings.AREAS` are their names.
            By default the named regions of the map that have such a name.

        Returns
        -------
        (T, C, 24) float32 array
            Averages are weighted by the areas of taxels; NaN where no taxel of an area has a reading.

        Raises
        ------
        DataError
            If a name is of no patch, or a number is of no area.

        Examples
        --------
        >>> import dermatome
        >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
        >>> readings, truth = dermatome.touch(palm, presses=1)
        >>> of_palm = readings.by_area(palm, {"skin": 5})[:, 0, 5]
        >>> bool(abs(of_palm - readings.values[:, 0].sum(axis=1)).max() < 1e-5)
        True
        """
        from dermatome.recordings.areas import by_area

        return by_area(self.on(map), map, areas)

    def to_xarray(self, map: Map | None = None) -> Any:
        """The values as an `xarray.DataArray` of the axes time, channel and taxel.

        Times, names and units of channels and ids of taxels are its coordinates, and `measured`; `is_tared` and `threshold` are
        its attributes.

        Parameters
        ----------
        map : Map, optional
            The map in whose order they are then: its taxels have the coordinates `patch`, `x`, `y`, `z` (m, in the frame of
            their link), `u`, `v` (m, on the map). Where patches share ids, `taxel_id` has them, and taxels are in the order
            of the map.

        Raises
        ------
        ImportError
            If xarray is not installed.
        DataError
            If readings are not of the map.
        """
        if map is not None:
            import numpy as np

            from dermatome._frames import places

            made = self.on(map).to_xarray()
            # Ids that several taxels have do not tell them apart: the order of the map does.
            is_unique = len(np.unique(map.ids)) == map.n_taxels
            ids: Any = {"taxel": map.ids} if is_unique else {"taxel_id": ("taxel", map.ids)}
            return made.assign_coords(**ids, **places(map))
        from dermatome._adapter import need

        xarray = need("xarray", "xarray")
        coords: dict[str, Any] = {"channel": list(self.channels), "unit": ("channel", list(self.units))}
        if _any_finite(self.timestamps):
            coords["time"] = self.timestamps
        if self.ids is not None:
            coords["taxel"] = self.ids
        if self.episodes is not None:
            coords["episode"] = ("time", self.episodes)
        made = xarray.DataArray(self.values, dims=("time", "channel", "taxel"), coords=coords, name="readings")
        if self.measured is not None:
            made.coords["measured"] = (made.dims, self.measured)
        # netCDF has no truth values.
        if self.kinds is not None:
            made.coords["kind"] = ("channel", list(self.kinds))
        made.attrs |= {"is_tared": 1} if self.is_tared else {}
        if self.tared is not None:
            made.coords["tared"] = ("channel", [int(flag) for flag in self.tared])
        if self.threshold is not None:
            made.attrs |= {"threshold": self.threshold, "threshold_channel": self.channels[_main(self)]}
        return made

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the recording to an .npz file that `read` and the command read without an option.

        Raises
        ------
        FileError
            If it cannot be written.
        DataError
            If some frames have times and others none, there is no frame or there are several episodes, or the threshold is no
            number above 0.
        """
        import numpy as np

        if not len(self):
            raise DataError("readings: found no frame; needed: one or more")
        if len(parts := self.by_episode()) > 1:
            raise DataError(f"readings: found {len(parts)} episodes; needed: one, as the file has no place for their numbers; by_episode() gives each")
        if self.threshold is not None and not 0 < self.threshold < float("inf"):
            raise DataError(f"threshold: found {self.threshold}; needed: a number above 0, or None")

        def by_taxel(array: Any) -> Any:
            # With one channel the axes are the same in every layout.
            return array[:, 0] if array.shape[1] == 1 else np.ascontiguousarray(np.moveaxis(array, 1, 2))

        arrays: dict[str, Any] = {"values": by_taxel(self.values), "layout": np.array("tnc")}
        arrays |= {"channels": np.array(self.channels), "units": np.array(self.units)}
        if self.ids is not None:
            arrays["ids"] = self.ids
        if self.measured is not None:
            arrays["measured"] = by_taxel(self.measured).astype(np.uint8)
        if self.kinds is not None:
            arrays["kinds"] = np.array(self.kinds)
        if self.is_tared or self.tared is not None:
            arrays["is_tared"] = np.uint8(1) if self.tared is None else np.array(self.tared, np.uint8)
        if self.threshold is not None:
            arrays["threshold"] = np.float64(self.threshold)
        finite = np.isfinite(self.timestamps)
        if finite.any():
            if not finite.all():
                raise DataError(f"timestamps: found none for frame {np.argmin(finite)}; needed: one for each frame, or none")
            arrays["timestamps"] = self.timestamps
        name = path_of("path", path)
        with written(name if name.endswith(".npz") else f"{name}.npz") as part:
            np.savez(part, **arrays)


def of_arrays(arrays: dict[str, Any]) -> Readings:
    """A recording that the library has read or made."""
    made = Readings(arrays["values"], arrays["ids"], arrays["timestamps"], tuple(arrays["channels"]), tuple(arrays["units"]))
    tared, threshold = arrays["rest"]
    kinds = None if arrays["kinds"] is None else tuple(arrays["kinds"])
    return rested(replace(made, threshold=threshold, kinds=kinds), tared)


def _main(readings: Readings) -> int:
    """The number of the channel that measures touches first, which `threshold` is of."""
    return main_channel(readings.channels, readings.units, readings.kinds)


def _stored(path: Any) -> tuple[Any, Any]:
    """The layout that an .npz names, and which of its values were measured (T, C, N)."""
    import numpy as np

    if not str(path).lower().endswith(".npz"):
        return None, None
    try:
        with np.load(path) as arrays:
            layout = str(arrays["layout"]) if "layout" in arrays.files else None
            if layout not in ("tnc", "tcn"):
                return None, None
            measured = arrays["measured"] == 1 if "measured" in arrays.files else None
    except Exception:  # Of a damaged file numpy raises what its parts do.
        return None, None  # `read_readings` says what is wrong.
    if measured is None or measured.ndim not in (2, 3):
        return layout, None
    if measured.ndim == 2:
        measured = measured[:, :, None]
        return layout, np.moveaxis(measured, 2, 1)
    return layout, measured if layout == "tcn" else np.moveaxis(measured, 2, 1)


def _times(given: Any, frames: int) -> NDArray[np.float64]:
    """Times of frames in s."""
    import numpy as np

    if given is None:
        return np.full(frames, np.nan)
    if np.ma.is_masked(given):
        raise DataError("timestamps: found masked numbers; needed: a time for each frame, NaN where there is none")
    try:
        array = np.asarray(given)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)  # `as_floats` says what is wrong.
    if array.dtype.kind in "mM":
        whole = array.astype(f"{array.dtype.kind}8[ns]")
        times = np.where(np.isnat(whole), np.nan, whole.astype(np.int64) * 1e-9)
    else:
        times = as_floats("timestamps", given)
    times = times.ravel()
    if len(times) != frames:
        raise DataError(f"timestamps: found {len(times)}; needed: {frames}")
    late = np.abs(np.nan_to_num(times)) > LATEST
    if late.any():
        first = int(np.argmax(late))
        raise DataError(f"timestamps: found {times[first]} for frame {first}; needed: s; nanoseconds * 1e-9 are s")
    return times


def names_of(argument: str, given: str | Sequence[str], count: int) -> tuple[str, ...]:
    """Names or units of `count` channels."""
    names = words_of(argument, given)
    if len(names) != count:
        raise DataError(f"{argument}: found {len(names)}; needed: {count}")
    return names


def channel_of(readings: Readings, channel: int | None) -> int:
    """The number of a channel; by default of the first that measures touches."""
    if channel is None:
        return _main(readings)
    number, count = whole_of("channel", channel, "the number of a channel"), len(readings.channels)
    if not -count <= number < count:
        raise DataError(f"channel: found {number}; needed: one of {count}")
    return number % count


def frames_of(frames: Any, count: int) -> Any:
    """What chooses frames of an array; one is a list of it, and beyond the last there is none, as in any sequence."""
    needed = "a number, a slice, a mask or an array of numbers; select(channel) and drop(ids) choose channels and taxels"
    try:
        return [range(count)[operator.index(frames)]]
    except TypeError:
        chosen = array_of("frames", frames, needed)
    if chosen.ndim != 1 or chosen.dtype.kind == "f" and chosen.size or chosen.dtype.kind == "b" and len(chosen) != count:
        raise ArgumentError(f"frames: found {chosen.dtype} of shape {chosen.shape}; needed: {needed}")
    return chosen if chosen.size else chosen.astype(int)


def _any_finite(times: Any) -> bool:
    import numpy as np

    return bool(np.isfinite(times).any())


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


Readings.__module__ = "dermatome"
