"""`dermatome.torch.Augment`: readings as they would be elsewhere on the skin, or of another skin."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch  # type: ignore[import-not-found, unused-ignore]

from dermatome._arguments import A_MAP, check_kind, number_of
from dermatome._dermatome import Map
from dermatome._errors import DataError


def _uniform(shape: Any, most: float) -> Any:
    """Numbers between `-most` and `most`, of the generator of torch, which loaders seed in each worker."""
    untyped: Any = torch
    return most * (2 * untyped.rand(shape, dtype=untyped.float64).numpy() - 1)


def _turned(uv: Any, middle: Any, angle: float) -> Any:
    cos, sin = np.cos(angle), np.sin(angle)
    return (uv - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle


class Augment:
    """Changes readings at random, for `Touches(augment=...)`: a touch moves on the skin, and the skin has faults.

    Each sample has one change, the same in all its frames: the touch moves on the map of each patch, turned about the middle of
    it, and its contact moves with it. Where it comes from beyond the map there is no reading (NaN); a contact that leaves the
    map is none. Amounts, as forces, move as amounts per area. Numbers are those of torch: `torch.manual_seed` repeats them.

    Parameters
    ----------
    map : Map
        The map of the readings.
    shift : float
        How far touches move along each axis of the map at most, in m.
    turn : float
        How far they turn at most, in rad.
    drop : float
        The share of taxels without a reading, 0 to 1.
    gain : float
        The standard deviation of the factor of the readings of a taxel, which is 1 in the mean.

    Raises
    ------
    DataError
        If a number is out of its range.

    Examples
    --------
    >>> import dermatome, torch
    >>> from dermatome.torch import Augment, Touches
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> augment = Augment(palm, shift=0.005, turn=0.2, drop=0.05, gain=0.1)
    >>> touches = Touches(palm, *dermatome.touch(palm, presses=1), size=[32, 32], augment=augment)
    >>> touches[10]["image"].shape
    torch.Size([1, 32, 32])
    """

    def __init__(self, map: Map, *, shift: float = 0.0, turn: float = 0.0, drop: float = 0.0, gain: float = 0.0) -> None:
        check_kind("map", map, Map, A_MAP)
        self.map, self.index = map, map.index()
        self.shift, self.turn, self.drop, self.gain = (
            _within(name, value, most) for name, value, most in (("shift", shift, 1e3), ("turn", turn, np.pi), ("drop", drop, 1.0), ("gain", gain, 1.0))
        )

    def sample(self) -> Change:
        """A change at random."""
        return Change(self)


def _within(name: str, value: Any, most: float) -> float:
    needed = f"a number from 0 to {most:.6g}"
    number = number_of(name, value, needed)
    if not 0 <= number <= most:
        raise DataError(f"{name}: found {value}; needed: {needed}")
    return number


class Change:
    """A change of readings, the same for all frames of a sample."""

    def __init__(self, of: Augment) -> None:
        untyped: Any = torch
        self.map, self._index, count = of.map, of.index, of.map.n_taxels
        # Where touches go: the middle, the angle and the shift of each patch.
        self.moves: dict[str, tuple[Any, float, Any]] = {}
        if of.shift or of.turn:
            for name, patch in of.map.patches.items():
                uv = patch.levels[0].uv
                middle = (uv.min(axis=0) + uv.max(axis=0)) / 2
                self.moves[name] = middle, float(_uniform((), of.turn)), _uniform(2, of.shift)
        self.dropped = untyped.rand(count).numpy() < of.drop if of.drop else None
        # Uniform, so that none is negative or far off.
        self.gains = 1 + _uniform(count, min(of.gain * 3**0.5, 1.0)) if of.gain else None

    def values(self, values: Any, extensive: tuple[bool, ...]) -> Any:
        """Changed readings (T, C, N)."""
        made: Any = np.array(values, dtype=np.float64)
        if self.moves:
            taxels, weights = self._sources()
            areas = np.concatenate([patch.levels[0].areas for patch in self.map.patches.values()])
            for channel, is_amount in enumerate(extensive):
                density = made[:, channel] / areas if is_amount else made[:, channel]
                # A taxel without a weight counts for nothing, also if it has no reading.
                parts = np.where(weights > 0, density[:, taxels] * weights, np.where(np.isnan(weights), np.nan, 0))
                moved = parts.sum(axis=2)
                made[:, channel] = moved * areas if is_amount else moved
        if self.gains is not None:
            made *= self.gains
        if self.dropped is not None:
            made[:, :, self.dropped] = np.nan
        return made

    def _sources(self) -> tuple[Any, Any]:
        """The three taxels (N, 3) between which the reading of each comes from, and their weights, NaN beyond the map."""
        taxels, weights = np.zeros((self.map.n_taxels, 3), np.int64), np.full((self.map.n_taxels, 3), np.nan)
        for number, (name, (middle, angle, shift)) in enumerate(self.moves.items()):
            patch, level = self.map.patches[name], self.map.patches[name].levels[0]
            # Of a taxel on a seam the last place.
            uv: Any = np.zeros((patch.n_taxels, 2))
            uv[level.vertex_of_place] = level.uv
            points, _, off = self.map.to_skin(name, _turned(uv - shift, middle, -angle))
            hits = self._index.locate(points, only_link=patch.link, level=None)
            good = (hits.patch == number) & (off <= _edge(level))
            rows = patch.start + np.flatnonzero(good)
            taxels[rows] = patch.start + level.faces[hits.face[good]]
            weights[rows] = hits.barycentric[good]
        return taxels, weights

    def contact(self, contact: dict[str, Any]) -> dict[str, Any]:
        """The contact of a frame, moved: none where it leaves the map."""
        if not (self.moves and contact["touched"]):
            return contact
        name = list(self.moves)[int(contact["patch"])]
        patch, (middle, angle, shift) = self.map.patches[name], self.moves[name]
        hits = self._index.locate(np.asarray(contact["centre"], dtype=np.float64)[None], only_link=patch.link, level=0)
        if hits.uv is None or hits.patch[0] != int(contact["patch"]):
            return contact
        point, _, off = self.map.to_skin(name, _turned(hits.uv, middle, angle) + shift)
        if off[0] > _edge(patch.levels[0]):
            return {"touched": False, "force": 0.0, "centre": np.zeros(3), "patch": -1}
        return {**contact, "centre": point[0]}


def _edge(level: Any) -> float:
    """How far beyond a map a place still counts as on its rim, in m: the rounding of places."""
    return 1e-6 * float(np.abs(level.uv).max())
