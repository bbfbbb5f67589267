"""What is known of readings where nothing touches."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dermatome._dermatome import is_of_touch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dermatome._readings import Readings


def of_touch(readings: Readings) -> list[bool]:
    """Which channels measure touches."""
    kinds: Sequence[str | None] = readings.kinds or (None,) * len(readings.channels)
    return [is_of_touch(name, unit, kind) for name, unit, kind in zip(readings.channels, readings.units, kinds)]


def rested(readings: Readings, flags: Sequence[bool]) -> Readings:
    """The readings, which are about 0 where nothing touches in these channels."""
    of = [bool(flag) for flag, is_touch in zip(flags, of_touch(readings)) if is_touch]
    is_mixed = any(of) and not all(of)
    return replace(readings, is_tared=bool(of) and all(of), tared=tuple(map(bool, flags)) if is_mixed else None)


def flags_of(readings: Readings) -> list[bool]:
    """Of each channel whether readings are about 0 where nothing touches."""
    return [readings.is_tared] * max(len(readings.channels), 1) if readings.tared is None else list(readings.tared)


def stand_still(times: Any) -> bool:
    """Whether frames have times, which are all the same."""
    return len(times) > 1 and bool((times == times[0]).all())
