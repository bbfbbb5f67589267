"""What the adapters to other packages share."""

from __future__ import annotations

import importlib
from typing import Any

from dermatome._arguments import A_MAP, check_kind, one_of, whole_of
from dermatome._dermatome import Level, Map, Patch
from dermatome._errors import DataError


def need(module: str, extra: str) -> Any:
    """The module of another package, or an error that says how it is installed."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as missing:
        raise ImportError(f"{module} is needed: pip install 'dermatome[{extra}]'") from missing


def patch_of(map: Map, patch: str | None) -> Patch:
    """The patch of a name; without one the only patch."""
    patches = patches_of(map)
    if patch is None and len(patches) == 1:
        return next(iter(patches.values()))
    return patches[one_of("patch", patch, list(patches))]


def patches_of(map: Map) -> dict[str, Patch]:
    """The patches of a map; an error of anything else."""
    check_kind("map", map, Map, A_MAP)
    return map.patches


def level_of(map: Map, patch: str | None, level: int) -> Level:
    """One level of a patch; its coarsest if it does not reach up to the level."""
    levels = patch_of(map, patch).levels
    return levels[min(checked(map, level), len(levels) - 1)]


def checked(map: Map, level: Any) -> int:
    """The number of a level of a map."""
    check_kind("map", map, Map, A_MAP)
    needed = f"a level from 0 to {map.n_levels - 1}"
    number = whole_of("level", level, needed)
    if not 0 <= number < map.n_levels:
        raise DataError(f"level: found {number}; needed: {needed}")
    return number


def field_counts(map: Map, level: int | str) -> list[tuple[str, int, slice]]:
    """Name, number of fields and fields of each patch, in the order of `Map.pool`; of a level without a mesh, as "body.L0", its own
    name and all its fields."""
    if isinstance(level, str):
        check_kind("map", map, Map, A_MAP)
        count = map.n_fields(level)
        return [(level, count, slice(0, count))]
    return [(name, len(of.areas), fields) for name, of, fields in fields_of(map, level)]


def fields_of(map: Map, level: int) -> list[tuple[str, Level, slice]]:
    """Name, level and fields of each patch, in the order of `Map.pool`."""
    made: list[tuple[str, Level, slice]] = []
    first = 0
    number = checked(map, level)
    for name, patch in map.patches.items():
        of = patch.levels[min(number, len(patch.levels) - 1)]
        count = len(of.areas)
        made.append((name, of, slice(first, first + count)))
        first += count
    return made
