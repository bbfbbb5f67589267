"""Makes readings comparable, and says what the command says about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dermatome._arguments import number_of, whole_of
from dermatome._dermatome import Map, as_floats, condition_readings, is_of_touch
from dermatome._errors import DataError
from dermatome._kinds import is_mapping
from dermatome._rest import flags_of, of_touch as which_touch, rested, stand_still

if TYPE_CHECKING:
    from dermatome._readings import Readings

@dataclass(frozen=True)
class Options:
    """The arguments of `Readings.condition`."""

    scale: Any
    offset: Any
    baseline: Any
    zero: Any
    gain: Any
    response: Any
    clip: Any
    split: float | None
    rate: float | None
    fill: str


def condition(readings: Readings, map: Map, options: Options) -> Readings:
    """The readings on the map, made comparable."""
    import numpy as np

    if len(parts := readings.by_episode()) > 1:
        return _joined(readings, [condition(part, map, options) for part in parts])
    of_map = readings.on(map)
    values, times, split = of_map.values, of_map.timestamps, options.split
    baseline: Any = options.baseline
    if options.rate is not None:
        rate = number_of("rate", options.rate, "a number above 0")
        if not 0 < rate < float("inf"):
            raise DataError(f"rate: found {rate}; needed: a number above 0")
        if not np.isfinite(times).any() or stand_still(times):
            times = np.arange(len(times)) / rate
    if split is not None:
        split = number_of("split", split, "a frequency in Hz")
    if split is not None and not np.isfinite(times).all():
        raise DataError("split: found readings without times; needed: rate")

    shape = values.shape[1:]
    for name, neutral, given in (("scale", 1.0, options.scale), ("offset", 0.0, options.offset)):
        number = per_taxel(name, given, shape)
        if not np.isfinite(number).all():
            raise DataError(f"{name}: found {number[~np.isfinite(number)][0]}; needed: finite numbers")
        if (number != neutral).any():
            values = values * number if name == "scale" else values + number
    follows = isinstance(options.zero, str)
    if options.zero is not None:
        if not is_number(baseline) or baseline != 0:
            raise DataError("zero: found a baseline, too; needed: one of the two")
        if not follows:
            baseline = np.full(shape[1], as_floats("zero", options.zero)) if is_number(options.zero) else options.zero
    if not is_number(baseline):
        with np.errstate(invalid="ignore"):  # Infinite readings are missing ones.
            values, baseline = values - of_touch("baseline" if options.zero is None else "zero", baseline, 0.0, of_map), 0
    gains: list[tuple[Any, Any]] = []
    gain: Any = options.gain
    if is_mapping(gain):
        gains = [(whole_of("gain", taxel, "ids of taxels"), number_of("gain", number, "numbers")) for taxel, number in gain.items()]
    elif gain is not None and follows:
        gains = _by_id(map, per_taxel("gain", gain, shape))
    elif gain is not None:
        # Before the mean of frames is subtracted: the result is the same.
        values = values * of_touch("gain", gain, 1.0, of_map)
    clip = None if options.clip is None else tuple(as_floats("clip", options.clip).ravel().tolist())
    if clip is not None and len(clip) != 2:
        raise DataError(f"clip: found {len(clip)} numbers; needed: 2, the lower one first")
    # What is subtracted here leaves readings about 0, and what is added does not.
    has_zero = not is_number(options.baseline) or options.zero is not None and not follows
    tared = which_touch(of_map) if has_zero else [False if np.any(options.offset) else flag for flag in flags_of(of_map)]
    arrays = condition_readings(
        map,
        values,
        readings.ids,
        times,
        list(of_map.channels),
        list(of_map.units),
        kinds=None if of_map.kinds is None else list(of_map.kinds),
        tared=tared[: len(of_map.channels)],
        baseline=baseline,
        zero=options.zero if follows else None,
        gains=gains,
        response=options.response,
        clip=clip,
        split_hz=split,
        fill=options.fill,
    )
    measured: Any = of_map.measured
    if measured is not None and split is not None:
        measured = np.repeat(measured, 2, axis=1)
    if options.fill != "none":
        measured = arrays["measured"] if measured is None else arrays["measured"] & measured
    # A threshold is one of readings about zero, or of those that have another.
    has_other = has_zero or options.zero is not None or options.baseline != 0
    same_zero = not has_other or (of_map.is_tared and values is of_map.values)
    is_as_stated = values is of_map.values and same_zero and not gains and split is None and options.response is None and clip is None
    made = replace(
        of_map,
        kinds=None if arrays["kinds"] is None else tuple(arrays["kinds"]),
        threshold=of_map.threshold if is_as_stated else None,
        values=arrays["values"],
        timestamps=times,
        channels=tuple(arrays["channels"]),
        units=tuple(arrays["units"]),
        measured=measured,
        remarks=tuple(dict.fromkeys((*of_map.remarks, *arrays["remarks"]))),
    )
    return rested(made, arrays["rest"][0])


def _joined(readings: Readings, parts: list[Readings]) -> Readings:
    """Episodes one after the other; what is said of one of them alone names it."""
    import numpy as np

    remarks = [
        remark if all(remark in other.remarks for other in parts) else f"episode {part.episode}: {remark}"
        for part in parts
        for remark in part.remarks
    ]
    measured = [part.measured for part in parts if part.measured is not None]
    return replace(
        parts[0],
        values=np.concatenate([part.values for part in parts]),
        timestamps=np.concatenate([part.timestamps for part in parts]),
        measured=np.concatenate(measured) if measured else None,
        remarks=tuple(dict.fromkeys(remarks)),
        episode=None,
        episodes=readings.episodes,
    )


def _by_id(map: Map, gains: Any) -> list[tuple[Any, Any]]:
    """Gains (C, N) by the ids of their taxels: they multiply what is above a zero that the library knows."""
    made: dict[Any, Any] = {}
    for column, taxel in zip(gains.T.tolist(), map.ids.tolist()):
        if any(gain != made.setdefault(taxel, column[0]) for gain in column):
            raise DataError(f"gain: found several for taxel {taxel}; needed: one for each id where zero is followed or stored")
    return list(made.items())


def is_number(given: Any) -> bool:
    """Whether an argument is one number, and no array."""
    import numpy as np

    try:
        return np.ndim(given) == 0
    except (TypeError, ValueError):
        return False


def of_touch(name: str, given: Any, neutral: float, readings: Readings) -> Any:
    """Numbers (C, N) of which those of channels that measure no touches are neutral, unless there is one for each channel."""
    import numpy as np

    shape = readings.values.shape[1:]
    array = per_taxel(name, given, shape)
    if np.ndim(given) == 2:
        return array
    unknown = ("",) * shape[0]
    kinds = readings.kinds or (None,) * shape[0]
    is_touch = [is_of_touch(*each) for each in zip(readings.channels or unknown, readings.units or unknown, kinds)]
    if not any(is_touch):
        raise DataError(f"{name}: found the channels {list(readings.channels)}; needed: one that measures touches, or shape {array.shape}")
    return np.where(np.array(is_touch)[:, None], array, neutral)


def per_taxel(name: str, given: Any, shape: tuple[int, ...]) -> Any:
    """A number, or one for each taxel or channel and taxel, as an array that goes with (C, N)."""
    import numpy as np

    array, (count, taxels) = as_floats(name, given), shape
    if array.shape not in ((), (taxels,), (count, taxels), (count, 1)):
        raise DataError(f"{name}: found shape {array.shape}; needed: a number, ({taxels},) or ({count}, {taxels})")
    return np.broadcast_to(array, shape)
