"""What happens to blocks of frames on their way from a reader to a map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from dermatome._dermatome import Map, join_readings
from dermatome._errors import DataError
from dermatome.recordings._track import Block


class Join:
    """Puts readings into the order of a map."""

    def __init__(self, map: Map | None, ids: Any, channels: Sequence[str], units: Sequence[str]) -> None:
        import numpy as np

        self.ids, self.order, self.missing = ids, None, None
        self.count: int | None = None
        self.remarks: tuple[str, ...] = ()
        if map is None:
            return
        if ids is None:
            self.count = map.n_taxels
            return
        self.ids = None
        # On patches with sensors of the modality of a channel these have its readings, and no other taxel.
        columns = np.tile(np.arange(len(ids), dtype=np.float64), (1, len(channels), 1))
        joined, said = join_readings(map, columns, ids, channels, units)
        self.remarks, missing = tuple(said), np.isnan(joined[0])
        order = np.where(missing, 0, joined[0]).astype(np.int64)
        self.missing = missing if missing.any() else None
        self.order = None if self.missing is None and (order == np.arange(len(ids))).all() else order

    def __call__(self, values: Any) -> Any:
        import numpy as np

        if self.count not in (None, values.shape[2]):
            raise DataError(f"readings: found {values.shape[2]} columns without ids; needed: {self.count}, one for each taxel of the map, or ids")
        if self.order is None:
            return values
        made = np.take_along_axis(values, self.order[None], axis=2)
        if self.missing is not None:
            made[:, self.missing] = np.nan
        return made


def learn_frames(decoder: Any) -> int:
    """How many frames a decoder takes at first."""
    return int(decoder.learn_frames) if decoder is not None else 1


def learnable(blocks: Iterator[Block], learn: int) -> Iterator[Block]:
    """The same blocks, the first of each episode with as many frames as a decoder learns from, or all of the episode."""
    import numpy as np

    first: list[Block] = []
    begun: int | None = None
    for block in blocks:
        if first and block.episode != first[0].episode:
            yield _merged(np, first)
            first = []
        if not first and block.episode == begun:
            yield block
            continue
        begun = block.episode
        first.append(block)
        if sum(len(each.values) for each in first) >= learn:
            yield _merged(np, first)
            first = []
    if first:
        yield _merged(np, first)


def _merged(np: Any, blocks: list[Block]) -> Block:
    made = blocks[0]
    if len(blocks) > 1:
        made.values = np.concatenate([block.values for block in blocks])
        if made.times is not None:
            made.times = np.concatenate([block.times for block in blocks])
        if made.zero is not None and made.zero.ndim == made.values.ndim:
            made.zero = np.concatenate([block.zero for block in blocks])
    return made
