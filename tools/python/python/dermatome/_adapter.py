"""What the adapters to other packages share."""

from __future__ import annotations

import importlib
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
    """One level of a patch."""
    levels = patch_of(map, patch).levels
    if not isinstance(level, int) or not 0 <= level < len(levels):
        raise DataError(f"level: found {level!r}; needed: a level from 0 to {len(levels) - 1}")
    return levels[level]
