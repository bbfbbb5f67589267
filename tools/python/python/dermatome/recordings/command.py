"""What the command takes from here: recordings that the library does not read itself, and drafts of their layouts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from dermatome._readings import Readings
from dermatome._rest import flags_of
from dermatome.recordings import is_container

if TYPE_CHECKING:
    from dermatome._recording import Recording


def opened(path: Any, stream: str | None, layout: Any, episode: int | None) -> tuple[list[int], Iterator[tuple[Any, ...]]] | None:
    """The frames of each episode of a recording, and blocks of them; None if the library reads the file itself."""
    if not is_container(path):
        return None
    recording = Readings.open(path, stream=stream, layout=layout, episode=episode)
    lengths = recording.episodes if episode is None else recording.episodes[episode : episode + 1]
    return list(lengths), _blocks(recording)


def _blocks(recording: Recording) -> Iterator[tuple[Any, ...]]:
    import numpy as np

    with recording:
        for part in recording.chunks():
            values = np.ascontiguousarray(part.values, np.float64)
            kinds = None if part.kinds is None else list(part.kinds)
            known = (flags_of(part), part.threshold, recording.statements, kinds)
            ids, times = np.ascontiguousarray(part.ids, np.uint32), np.ascontiguousarray(part.timestamps, np.float64)
            yield (part.episode or 0, ids, part.channels, part.units, times, values, *known)


def drafted(path: Any, stream: str | None) -> str | None:
    """The text of a layout of a recording, with null where nobody knows; None if the library reads the file itself."""
    if not is_container(path):
        return None
    with Readings.open(path, stream=stream) as recording:
        return str(recording.draft())
