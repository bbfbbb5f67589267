"""Makes again what was pickled as a map and what was asked of it."""

from __future__ import annotations

from typing import Any

from dermatome._dermatome import Calibration, ContactTracker, Index, Level, Map, Observations, Patch, Picture, Renderer, calibrate_taxels


def index(map: Map, reactive: bool, fields: bool, poses: dict[str, Any]) -> Index:
    made = map.index(reactive=reactive, fields=fields)
    return made.posed(poses) if poses else made


def renderer(map: Map, options: dict[str, Any]) -> Renderer:
    return map.renderer(**options)


def picture(map: Map, values: Any, options: dict[str, Any]) -> Picture:
    return map.plot(values, **options)


def calibration(observations: Observations, options: tuple[Any, ...]) -> Calibration:
    names = ("robust", "residual", "initial", "iterations", "covariances")
    return calibrate_taxels(observations, dict(zip(names, options)), 0)


def patch(map: Map, name: str) -> Patch:
    return map.patches[name]


def level(map: Map, name: str, number: int) -> Level:
    return map.patches[name].levels[number]


def tracker(map: Map, options: dict[str, Any], state: dict[str, Any]) -> ContactTracker:
    made: Any = ContactTracker(map, **options)
    made._resume(state)
    tracker: ContactTracker = made
    return tracker
