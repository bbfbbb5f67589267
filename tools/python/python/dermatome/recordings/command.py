"""What the command takes from here: recordings that the library does not read itself, and drafts of their layouts."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from dermatome._errors import Error
from dermatome._readings import Readings
from dermatome._whole import written
from dermatome.recordings import is_container

if TYPE_CHECKING:
    from dermatome._recording import Recording

OUTPUTS = ("-o", "--output")
STREAM = "--stream"


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
            known = (part.is_tared, part.threshold, recording.statements)
            ids, times = np.ascontiguousarray(part.ids, np.uint32), np.ascontiguousarray(part.timestamps, np.float64)
            yield (part.episode or 0, ids, part.channels, part.units, times, values, *known)


def draft(args: Sequence[str]) -> int | None:
    """The exit code of `layout` with these arguments; None if they name no recording that is read here."""
    rest, stream = list(args), None
    for k, each in enumerate(rest):
        name, is_joined, value = each.partition("=")
        if name == STREAM and (is_joined or k + 1 < len(rest)):
            stream = value if is_joined else rest[k + 1]
            del rest[k : k + (1 if is_joined else 2)]
            break
    at = next((k for k, each in enumerate(rest) if (k == 0 or rest[k - 1] not in OUTPUTS) and is_container(each)), None)
    if at is None:
        return None
    try:
        with Readings.open(rest.pop(at), stream=stream) as recording:
            text = recording.draft()
    except (Error, ImportError) as error:
        return _refused(str(error))
    if len(rest) == 2 and rest[0] in OUTPUTS:
        try:
            with written(rest[1]) as part:
                part.write_text(text, encoding="utf-8")
        except Error as error:
            return _refused(str(error))
    elif rest:
        return _refused(f"found {' '.join(rest)}; needed: -o, the layout that is written")
    else:
        print(text)
    return 0


def _refused(why: str) -> int:
    print(f"error: {why}", file=sys.stderr)
    return 2
