"""Makes readings comparable, and says what the command says about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dermatome._dermatome import Map, as_floats, condition_readings
from dermatome._errors import DataError

if TYPE_CHECKING:
    from dermatome._readings import Readings

# Ids that a remark names.
NAMED = 10


@dataclass(frozen=True)
class Options:
    """The arguments of `Readings.condition`."""

    scale: Any
    offset: Any
    baseline: Any
    gain: Any
    clip: Any
    split: float | None
    rate: float | None
    fill: str


def joined(map: Map, ids: Any) -> list[str]:
    """How columns with these ids and the taxels of a map fit each other."""
    import numpy as np

    unknown = ids[~np.isin(ids, map.ids)]
    has_reading = np.isin(map.ids, ids) & (map.present == 1)
    known, counts = np.unique(map.ids, return_counts=True)
    shared = int(np.isin(known[counts > 1], ids).sum())
    said = []
    if len(unknown):
        names = ", ".join(str(id) for id in unknown[:NAMED]) + (", ..." if len(unknown) > NAMED else "")
        said.append(f"{len(unknown)} columns are of no taxel of the map: {names}")
    if not has_reading.all():
        said.append(f"{has_reading.sum()} taxels have readings, {(~has_reading).sum()} have none and are masked")
    if shared:
        said.append(f"{shared} ids belong to several taxels, which share the readings")
    return said


def condition(readings: Readings, map: Map, options: Options) -> Readings:
    """The readings on the map, made comparable."""
    import numpy as np

    of_map = readings.on(map)
    values, times, split, baseline = of_map.values, of_map.timestamps, options.split, options.baseline
    has_times = bool(np.isfinite(times).any())
    if options.rate is not None and not has_times:
        if not 0 < options.rate < float("inf"):
            raise DataError(f"rate: found {options.rate}; needed: a number above 0")
        times, has_times = np.arange(len(times)) / options.rate, True
    if split is not None and not np.isfinite(times).all():
        raise DataError("split: found readings without times; needed: rate")
    served = map.present == 1
    if readings.ids is not None:
        served &= np.isin(map.ids, readings.ids)

    shape = values.shape[1:]
    for name, neutral, given in (("scale", 1.0, options.scale), ("offset", 0.0, options.offset)):
        number = per_taxel(name, given, shape)
        if not np.isfinite(number).all():
            raise DataError(f"{name}: found {number[~np.isfinite(number)][0]}; needed: finite numbers")
        if (number != neutral).any():
            values = values * number if name == "scale" else values + number
    if not is_number(baseline):
        values, baseline = values - per_taxel("baseline", baseline, shape), 0
    gains: list[tuple[Any, Any]] = []
    if isinstance(options.gain, Mapping):
        gains = list(options.gain.items())
    elif options.gain is not None:
        # Before the mean of frames is subtracted: the result is the same.
        values = values * per_taxel("gain", options.gain, shape)
    clip = None if options.clip is None else tuple(options.clip)
    if clip is not None and len(clip) != 2:
        raise DataError(f"clip: found {len(clip)} numbers; needed: 2, the lower one first")
    about = (None, times, list(of_map.channels), list(of_map.units))
    how: dict[str, Any] = {"baseline": baseline, "gains": gains, "clip": clip, "split_hz": split, "fill": options.fill}
    arrays = condition_readings(map, values, *about, **how)
    made, names, is_filled = arrays["values"], arrays["channels"], options.fill != "none"
    missing = unknown(of_map.values)
    unfilled = np.where(arrays["measured"], made, np.nan) if is_filled else made
    said = tally(map, values, unfilled, missing, served, times if has_times else None, options)
    measured: Any = of_map.measured
    if measured is not None and split is not None:
        measured = np.repeat(measured, 2, axis=1)
    if is_filled:
        measured = arrays["measured"] if measured is None else arrays["measured"] & measured
    units = of_map.units if split is None else tuple(unit for unit in of_map.units for _ in range(2))
    remarks = tuple(dict.fromkeys((*of_map.remarks, *said)))
    given_names = tuple(names)
    return replace(of_map, values=made, timestamps=times, channels=given_names, units=units, measured=measured, remarks=remarks)


def unknown(values: Any) -> Any:
    """Which values (T, C, N) are not finite; None if there are none."""
    import numpy as np

    with np.errstate(all="ignore"):
        if np.isfinite(values.sum()):  # Faster than a look at each.
            return None
    lost = ~np.isfinite(values)
    return lost if lost.any() else None


def is_number(given: Any) -> bool:
    """Whether an argument is one number, and no array."""
    import numpy as np

    try:
        return np.ndim(given) == 0
    except (TypeError, ValueError):
        return False


def per_taxel(name: str, given: Any, shape: tuple[int, ...]) -> Any:
    """A number, or one for each taxel or channel and taxel, as an array that goes with (C, N)."""
    import numpy as np

    array, (count, taxels) = as_floats(name, given), shape
    if array.shape not in ((), (taxels,), (count, taxels), (count, 1)):
        raise DataError(f"{name}: found shape {array.shape}; needed: a number, ({taxels},) or ({count}, {taxels})")
    return np.broadcast_to(array, shape)


def counted(count: int, things: str, how: str) -> str:
    """What the command says about some things."""
    return f"1 {things.rstrip('s')} is {how}" if count == 1 else f"{count} {things} are {how}"


def tally(map: Map, values: Any, made: Any, missing: Any, served: Any, times: Any, options: Options) -> list[str]:
    """What the command says about readings before (`values`) and after (`made`) they were conditioned."""
    import numpy as np

    frames, (count, taxels), gain = len(values), values.shape[1:], options.gain
    first = min(int(options.baseline), frames) if is_number(options.baseline) else 0
    said, lacks_baseline, mean = [], np.zeros((count, taxels), dtype=bool), np.zeros((count, taxels))
    if is_number(options.baseline) and frames < options.baseline:
        said.append(f"the zero is the mean of {frames} frames, there are no {options.baseline}")
    if first:
        found = np.isfinite(values[:first])
        lacks_baseline = ~found.any(axis=0)
        with np.errstate(all="ignore"):
            mean = np.where(found, values[:first], 0).sum(axis=0) / found.sum(axis=0)
    made = made[:, :: 1 if options.split is None else 2]

    lost, too_large = unknown(made), 0
    if lost is not None:
        lost = lost[:, served_both := ~lacks_baseline & (map.present == 1)]
        before = unknown(values)
        too_large = int(np.count_nonzero(lost if before is None else lost & ~before[:, served_both]))
    clipped = 0
    if options.clip is not None:
        low, high = options.clip
        factor = np.array([gain.get(int(id), 1.0) for id in map.ids]) if isinstance(gain, Mapping) else 1.0
        most, step = float(np.finfo(np.float32).max), max(1, (1 << 17) // max(count * taxels, 1))
        for start in range(0, frames, step):  # So that numbers stay in the cache.
            with np.errstate(all="ignore"):
                free = (values[start : start + step] - mean) * factor
            # NaN is neither.
            below = np.count_nonzero(free < max(low, -most)) - np.count_nonzero(free < -most)
            clipped += int(below + np.count_nonzero(free > min(high, most)) - np.count_nonzero(free > most))
    backwards = 0
    if times is not None:
        latest = np.fmax.accumulate(times)
        backwards = int((np.isnan(times) | (times < np.concatenate([[-np.inf], latest[:-1]]))).sum())
    counts = (
        (0 if missing is None else int(np.count_nonzero(missing[:, :, served])), "readings", "missing, NaN or infinite, and masked"),
        (clipped, "readings", "clipped"),
        (too_large, "readings", "beyond the range of 32-bit floats, and masked"),
        (backwards, "frames", "earlier than the frame before"),
        (int(lacks_baseline[:, served].sum()), "readings", "without a zero, since none of the first frames has one, and masked"),
        (len(set(gain) - set(map.ids.tolist())) if isinstance(gain, Mapping) else 0, "gains", "of no taxel of the map"),
    )
    return said + [counted(number, things, how) for number, things, how in counts if number]
