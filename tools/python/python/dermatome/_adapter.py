"""What the adapters to other packages share."""

from __future__ import annotations

import importlib
import operator
from typing import Any

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
    patches = map.patches
    if patch is None and len(patches) == 1:
        return next(iter(patches.values()))
    if patch not in patches:
        raise DataError(f"patch: found {patch!r}; needed: one of {list(patches)[:10]}")
    return patches[patch]


def level_of(map: Map, patch: str | None, level: int) -> Level:
    """One level of a patch; its coarsest if it does not reach up to the level."""
    levels = patch_of(map, patch).levels
    return levels[min(checked(map, level), len(levels) - 1)]


def checked(map: Map, level: Any) -> int:
    """The number of a level of a map."""
    try:
        number = operator.index(level)
    except TypeError:
        number = -1
    if not 0 <= number < map.n_levels:
        raise DataError(f"level: found {level!r}; needed: a level from 0 to {map.n_levels - 1}")
    return number


def field_counts(map: Map, level: int | str) -> list[tuple[str, int, slice]]:
    """Name, number of fields and fields of each patch, in the order of `Map.pool`; of a level without a mesh, as "body.L0", its own
    name and all its fields."""
    if isinstance(level, str):
        count = map.n_fields(level)
        return [(level, count, slice(0, count))]
    return [(name, len(of.areas), fields) for name, of, fields in fields_of(map, level)]


def fields_of(map: Map, level: int) -> list[tuple[str, Level, slice]]:
    """Name, level and fields of each patch, in the order of `Map.pool`."""
    made: list[tuple[str, Level, slice]] = []
    first = 0
    for name, patch in map.patches.items():
        of = patch.levels[min(checked(map, level), len(patch.levels) - 1)]
        count = len(of.areas)
        made.append((name, of, slice(first, first + count)))
        first += count
    return made
