"""The functional areas of a hand that Open-X-Tactile numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dermatome._dermatome import Map
from dermatome._errors import DataError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dermatome._readings import Readings

FINGERS = ("thumb", "index", "middle", "ring", "little")
# By their numbers; the loader of FTP-1 adds 24 for a left hand by itself.
AREAS = (
    *(f"tip of {finger}" for finger in FINGERS),
    "palm",
    "base of thumb",
    *(f"middle of {finger}" for finger in FINGERS[1:]),
    *(f"base of {finger}" for finger in FINGERS[1:]),
    "torque of wrist",
    *(f"torque of {finger}" for finger in FINGERS),
    "unused 21",
    "unused 22",
    "unused 23",
)


def by_area(readings: Readings, map: Map, areas: Any) -> NDArray[np.float32]:
    """The values of all areas (T, C, 24) of readings in the order of a map."""
    import numpy as np

    if isinstance(areas, Mapping):
        wrong = [patch for patch in areas if patch not in map.patches]
        if wrong:
            raise DataError(f"areas: found the patch {wrong[0]!r}; needed: one of {list(map.patches)[:10]}")
        numbers = np.concatenate([np.full(patch.n_taxels, areas.get(name, -1)) for name, patch in map.patches.items()])
    else:
        numbers = np.asarray(areas)
        if numbers.shape != (map.n_taxels,):
            raise DataError(f"areas: found shape {numbers.shape}; needed: ({map.n_taxels},), one for each taxel")
    if numbers.dtype.kind not in "iu" or not ((numbers >= -1) & (numbers < len(AREAS))).all():
        raise DataError(f"areas: found numbers that are no areas; needed: -1 to {len(AREAS) - 1}")
    of_taxel = np.concatenate([patch.levels[0].areas for patch in map.patches.values()])
    made = np.full((*readings.values.shape[:2], len(AREAS)), np.nan, np.float32)
    for area in np.unique(numbers[numbers >= 0]):
        taxels = np.flatnonzero((numbers == area) & (map.present == 1))
        values = readings.values[:, :, taxels]
        known, weights = np.isfinite(values), of_taxel[taxels]
        sums = np.where(known, values, 0).astype(np.float64)
        weighted, total = sums @ weights, known @ weights
        with np.errstate(all="ignore"):
            average = weighted / total
        for channel, extensive in enumerate(readings.extensive):
            found = sums[:, channel].sum(axis=1) if extensive else average[:, channel]
            made[:, channel, area] = np.where(known[:, channel].any(axis=1), found, np.nan)
    return made
