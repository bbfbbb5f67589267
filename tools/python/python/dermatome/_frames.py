"""Recordings from and to tables of other packages, and parts of them."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dermatome._arguments import number_of
from dermatome._dermatome import main_channel
from dermatome._errors import ArgumentError, DataError

if TYPE_CHECKING:
    from dermatome._dermatome import Map
    from dermatome._readings import Readings

# Units of times besides s.
SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
# Frames further apart than this many of their steps have nothing between them.
PAUSE = 2.5
# Times that are sums of steps differ from those of a clock by less than this part of a step.
ROUNDING = 1e-6


def from_xarray(make: Any, array: Any) -> Readings:
    """A `DataArray` of the axes time and taxel, and channel if there are several, in any order."""
    import numpy as np

    from dermatome._rest import rested

    dims: list[str] = list(getattr(array, "dims", ()))
    if hasattr(array, "data_vars"):
        raise ArgumentError(f"array: found {type(array).__name__} of {[str(name) for name in array.data_vars]}; needed: a DataArray, as dataset[name] is")
    if sorted(dims) not in (["taxel", "time"], ["channel", "taxel", "time"]):
        raise DataError(f"array: found the axes {dims}; needed: time and taxel, and channel if there are several")
    array = array.transpose("time", *(["channel"] if "channel" in dims else []), "taxel")

    def of(name: str) -> Any:
        return array.coords[name].values if name in array.coords else None

    names, units = of("channel"), of("unit")
    words = None if names is None else [str(name) for name in np.atleast_1d(names)]
    units = None if units is None else [str(unit) for unit in np.atleast_1d(units)]
    if "units" in array.attrs:
        stated = str(array.attrs["units"])
        # Arithmetic of xarray keeps coordinates and drops attributes: two that differ are not the same unit.
        if units is not None and any(unit != stated for unit in units):
            raise DataError(f"array: found units={stated!r} and the coordinate unit {units}; needed: one of the two; array.drop_vars('unit') leaves the unit out")
        units = units or stated
    # Of a map whose patches share ids taxels are in its order.
    ids = None if "taxel_id" in array.coords else of("taxel")
    times = of("time")
    if "time" in array.coords:
        times = _in_s(times, str(array.coords["time"].attrs.get("units", "")), "array: time")
    made: Readings = make(array.values, ids=ids, timestamps=times, channels=words, units=units)
    threshold = array.attrs.get("threshold")
    threshold = None if threshold is None else number_of("threshold", threshold, "a number, as an attribute")
    if threshold is not None and not 0 < threshold < float("inf"):
        raise DataError(f"threshold: found {threshold}; needed: a number above 0, as an attribute")
    # It is of one channel, which may not be among those that were chosen.
    kinds = of("kind")
    if kinds is not None:
        made = replace(made, kinds=tuple(str(kind) for kind in np.atleast_1d(kinds)))
    of_main = made.channels[main_channel(made.channels, made.units, made.kinds)]
    if array.attrs.get("threshold_channel", of_main) != of_main:
        threshold = None
    made = replace(made, is_tared=bool(array.attrs.get("is_tared", False)), threshold=threshold)
    if of("tared") is not None:
        made = rested(made, [bool(flag) for flag in np.atleast_1d(of("tared"))])
    measured, episodes = of("measured"), of("episode")
    if episodes is not None and np.ndim(episodes) == 1:
        made = replace(made, episodes=np.asarray(episodes, dtype=np.int64))
    return made if measured is None else replace(made, measured=measured.reshape(made.values.shape).astype(bool))


def _in_s(times: Any, unit: str, what: str) -> Any:
    """Times of this unit as those in s; dates and durations say what they are."""
    import numpy as np

    if np.asarray(times).dtype.kind in "mM" or unit in ("", "s"):
        return times
    if unit not in SECONDS:
        raise DataError(f"{what}: found the unit {unit!r}; needed: one of {['s', *SECONDS]}, or dates")
    return np.asarray(times, dtype=float) * SECONDS[unit]


def from_pandas(make: Any, table: Any, units: Any) -> Readings:
    """A `DataFrame`: a row a frame, a column a taxel."""
    import numpy as np

    if not hasattr(table, "columns") or not hasattr(table, "index"):
        raise ArgumentError(f"table: found {type(table).__name__}; needed: a DataFrame")
    columns, index = list(table.columns), table.index
    ids: list[int] = []
    for column in columns:
        # A pivot makes floats of whole numbers.
        text = str(int(column)) if isinstance(column, float) and column.is_integer() else str(column)
        if not text.isdecimal():
            raise DataError(f"table: found the column {text!r}; needed: ids of taxels; table.drop(columns={[text]}) leaves it out")
        ids.append(int(text))
    # A table without an index of its own counts its rows, also where some were left out.
    times: Any = None
    counts = index.name is None and getattr(index.dtype, "kind", "") in "iu"
    if type(index).__name__ == "PeriodIndex":
        index = index.to_timestamp()
    if not counts:
        index = index if getattr(index, "tz", None) is None else index.tz_convert("UTC").tz_localize(None)
        head = re.search(r"\[(.*)\]\s*$", str(index.name or ""))
        times = _in_s(index.to_numpy(), head[1] if head else "", "table: index")
    if getattr(times, "dtype", None) == object:
        # An empty index has no type.
        if len(times):
            raise DataError(f"table: found an index of {type(times[0]).__name__}; needed: times, as numbers in s or dates")
        times = None
    try:
        values = table.to_numpy(dtype=float)
    except (TypeError, ValueError) as error:
        raise DataError(f"table: found {error}; needed: numbers in all cells, NaN where there is none") from None
    made: Readings = make(values, ids=np.array(ids), timestamps=times, units=units)
    if counts and type(table.index).__name__ != "RangeIndex":
        made = replace(made, remarks=(*made.remarks, "the index counts rows and has no name: the frames have no times"))
    return made


def places(map: Map) -> dict[str, Any]:
    """Patch, position in the frame of the link, and place on the map of each taxel of a map."""
    import numpy as np

    parts: list[tuple[Any, Any, Any]] = []
    for name, patch in map.patches.items():
        level = patch.levels[0]
        first = np.zeros(len(level.positions), dtype=np.int64)
        # Of a taxel on a seam the first place.
        first[level.vertex_of_place[::-1]] = np.arange(len(level.uv))[::-1]
        parts.append((np.full(len(first), name, dtype=object), level.positions, level.uv[first]))
    joined: list[Any] = [np.concatenate(part) for part in zip(*parts)]
    patches, positions, uv = joined
    columns = [*positions.transpose(), *uv.transpose()]
    return {"patch": ("taxel", patches.astype(str))} | {name: ("taxel", of) for name, of in zip("xyzuv", columns)}


def crop(readings: Readings, begin: float | None, end: float | None) -> Readings:
    """The frames from one time to before another."""
    import numpy as np

    times = readings.timestamps
    if not np.isfinite(times).all():
        raise DataError("readings: found frames without a time; needed: times; readings[10:50] are frames by number")
    chosen = np.ones(len(times), dtype=bool)
    if begin is not None:
        chosen &= times >= number_of("begin", begin, "a time in s")
    if end is not None:
        chosen &= times < number_of("end", end, "a time in s")
    if not chosen.any() and len(times):
        needed = f"times from {times.min():.6g} to {times.max():.6g} s"
        raise DataError(f"begin, end: found no frame from {begin} to {end} s; needed: {needed}")
    return readings[chosen]


def resample(readings: Readings, rate: float) -> Readings:
    """The same recording with this many frames per second; each episode for itself."""
    import numpy as np

    rate = number_of("rate", rate, "frames per second above 0")
    if not 0 < rate < float("inf"):
        raise DataError(f"rate: found {rate}; needed: frames per second above 0")
    made = [_resampled(part, rate) for part in readings.by_episode()]
    if readings.episodes is None:
        return made[0]
    episodes = np.repeat(np.array([part.episode for part in made]), [len(part) for part in made])
    masks: list[Any] = [part.measured for part in made]
    measured: Any = None if readings.measured is None else np.concatenate(masks)
    values, times = np.concatenate([part.values for part in made]), np.concatenate([part.timestamps for part in made])
    return replace(readings, values=values, timestamps=times, measured=measured, episodes=episodes)


def _resampled(readings: Readings, rate: float) -> Readings:
    import numpy as np

    times, values = readings.timestamps, readings.values
    if len(times) < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise DataError("readings: found times that do not increase; needed: a time for each of two or more frames")
    step = float(np.median(np.diff(times)))
    # Times of a clock have the rounding of their size.
    slack = 2 * rate * np.spacing(np.abs(times).max())
    new = times[0] + np.arange(int(np.floor((times[-1] - times[0]) * rate * (1 + 1e-12) + slack)) + 1) / rate
    measured = readings.measured
    if measured is not None:
        measured = np.isfinite(_at(new, rate, step, times, np.where(measured, values, np.nan)))
    return replace(readings, values=_at(new, rate, step, times, values), timestamps=new, measured=measured)


def _at(new: Any, rate: float, step: float, times: Any, values: Any) -> Any:
    """Values at new times, by those at usual steps."""
    import numpy as np

    made = np.full((len(new), *values.shape[1:]), np.nan)
    # Means of the frames around each new time, where there are several.
    find: Any = times.searchsorted
    low, after, high = (find(at) for at in (new - (0.5 + ROUNDING) / rate, new, new + (0.5 - ROUNDING) / rate))
    for k, (first, end) in enumerate(zip(low, high)):
        if end - first > 1:
            known = np.isfinite(values[first:end])
            count = known.sum(axis=0)
            sums = np.where(known, values[first:end], 0).sum(axis=0)
            made[k] = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
            continue
        b = min(after[k], len(times) - 1)
        a = b if times[b] <= new[k] else b - 1
        if times[b] - times[a] <= PAUSE * step:
            share = 0.0 if a == b else (new[k] - times[a]) / (times[b] - times[a])
            made[k] = values[a] if share == 0 else (1 - share) * values[a] + share * values[b]
    return made
