"""The functional areas of a hand that Open-X-Tactile numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dermatome._arguments import array_of
from dermatome._dermatome import Map
from dermatome._errors import DataError
from dermatome._kinds import is_mapping

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


def area_numbers(map: Map, areas: Any) -> NDArray[np.int64]:
    """The area of each taxel of a map, -1 for none: of its patch, as given, or by the name of its region."""
    import numpy as np

    numbers: NDArray[Any]
    if areas is None:
        known = [AREAS.index(name) if name in AREAS else -1 for name in map.regions]
        if not any(number >= 0 for number in known):
            raise DataError(f"areas: found none, and the regions {list(map.regions)[:10]}; needed: areas, or regions named as {list(AREAS[:7])}, ...")
        numbers = np.array([*known, -1])[map.region_of]
    elif is_mapping(areas):
        wrong = [patch for patch in areas if patch not in map.patches]
        if wrong:
            raise DataError(f"areas: found the patch {wrong[0]!r}; needed: one of {list(map.patches)[:10]}")
        numbers = np.concatenate([np.full(patch.n_taxels, areas.get(name, -1)) for name, patch in map.patches.items()])
    else:
        numbers = array_of("areas", areas, "the area of each patch by its name, or of each taxel")
        if numbers.shape != (map.n_taxels,):
            raise DataError(f"areas: found shape {numbers.shape}; needed: ({map.n_taxels},), one for each taxel")
    if numbers.dtype.kind not in "iu" or not ((numbers >= -1) & (numbers < len(AREAS))).all():
        raise DataError(f"areas: found numbers that are no areas; needed: -1 to {len(AREAS) - 1}")
    return numbers


def by_area(readings: Readings, map: Map, areas: Any) -> NDArray[np.float32]:
    """The values of all areas (T, C, 24) of readings in the order of a map."""
    import numpy as np

    numbers = [int(number) for number in area_numbers(map, areas)]
    kinds = enumerate(zip(readings.extensive, readings.modalities(map)))
    parts = [map._pool_groups(readings.values[:, k], numbers, len(AREAS), extensive=kind, modality=of) for k, (kind, of) in kinds]
    return np.stack(parts, axis=1)
