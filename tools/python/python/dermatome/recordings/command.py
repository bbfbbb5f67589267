"""`render` and `layout` of recordings that the command does not read itself: frames go to it through a pipe."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from dermatome._errors import Error
from dermatome._readings import Readings
from dermatome.recordings import is_container

if TYPE_CHECKING:
    from dermatome._recording import Recording

# Arguments that are of this module, with their values.
OWN = ("--layout", "--stream", "--episode")
# What follows a frame from the one before it, and would join episodes.
ONE_EPISODE = ("--split", "--contacts", "--events", "--zero")
# Options with a value that may stand before the subcommand.
VALUED = ("--threads", "--color")
OUTPUTS = ("-o", "--output")
COMMAND = "import sys; from dermatome._dermatome import run_command; sys.exit(run_command(sys.argv[1:]))"


def run(args: Sequence[str]) -> int | None:
    """The exit code of these arguments; None if they are no command that is here, or name no recording that is read here."""
    first = (k for k, each in enumerate(args) if not each.startswith("-") and (k == 0 or args[k - 1] not in VALUED))
    begin = next(first, len(args))
    command, rest = next(iter(args[begin:]), ""), list(args[begin + 1 :])
    if command == "render":
        rest += args[:begin]
    elif command != "layout":
        return None
    at = next((k for k, each in enumerate(rest) if (k == 0 or rest[k - 1] not in (*OWN, *OUTPUTS)) and is_container(each)), None)
    if at is None:
        return None
    path = rest.pop(at)
    given, rest = _own(rest)
    try:
        episode = None if given["--episode"] is None else int(given["--episode"])
    except ValueError:
        return _refused(f"--episode: found {given['--episode']!r}; needed: a whole number from 0")
    try:
        with Readings.open(path, stream=given["--stream"], layout=given["--layout"], episode=episode) as recording:
            if command == "layout":
                return _draft(recording, rest)
            return _render(recording, at, rest)
    except (Error, ImportError) as error:
        return _refused(str(error))


def _own(rest: list[str]) -> tuple[dict[str, str | None], list[str]]:
    """The arguments of this module, and the others."""
    given: dict[str, str | None] = dict.fromkeys(OWN)
    others, k = [], 0
    while k < len(rest):
        name, is_joined, value = rest[k].partition("=")
        if name in OWN and (is_joined or k + 1 < len(rest)):
            given[name] = value if is_joined else rest[k + 1]
            k += 1 if is_joined else 2
        else:
            others.append(rest[k])
            k += 1
    return given, others


def _refused(why: str) -> int:
    print(f"error: {why}", file=sys.stderr)
    return 2


def _draft(recording: Recording, rest: list[str]) -> int:
    text = recording.draft()
    if len(rest) == 2 and rest[0] in OUTPUTS:
        Path(rest[1]).write_text(text, encoding="utf-8")
    elif rest:
        return _refused(f"found {' '.join(rest)}; needed: -o, the layout that is written")
    else:
        print(text)
    return 0


def _render(recording: Recording, at: int, rest: list[str]) -> int:
    if len(recording.episodes) > 1 and recording.episode is None:
        joining = [each for each in rest if each.partition("=")[0] in ONE_EPISODE]
        lengths = f"{len(recording.episodes)} episodes"
        if joining:
            return _refused(f"{recording.path}: found {lengths} with {joining[0]}; needed: --episode, the number of one")
        if not {"--quiet", "-q"} & set(rest):
            print(f"note: {recording.path}: {lengths}, drawn one after the other; --episode draws one", file=sys.stderr)
    wants_json = "--json" in rest
    parts = recording.chunks()
    first = next(parts)
    channels = [f"--readings-unit={unit}" for unit in first.units]
    if any(each.partition("=")[0] == "--readings-unit" for each in rest):
        channels = []
    rest.insert(at, "-")
    command = [sys.executable, "-c", COMMAND, "dermatome", "render", *rest, *channels]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(each for each in sys.path if each)}
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE if wants_json else None, env=environment)
    pipe: Any = process.stdin
    try:
        _write(pipe, first, parts)
        pipe.close()
    except BrokenPipeError:
        pass  # The command says why it stopped.
    except Error:
        process.kill()
        process.wait()
        raise
    said = process.stdout.read() if process.stdout else b""
    code = process.wait()
    if wants_json and said:
        try:
            print(json.dumps({**json.loads(said), "statements": recording.statements}))
        except ValueError:
            sys.stdout.write(said.decode())
    return code


def _write(pipe: IO[bytes], first: Any, parts: Any) -> None:
    """Readings as CSV: a time, then a column for each taxel and channel."""
    names = [f"{id}.{name}" if len(first.channels) > 1 else str(id) for name in first.channels for id in first.ids]
    pipe.write(f"time,{','.join(names)}\n".encode())
    digits = "%.9g" if first.values.dtype.itemsize == 4 else "%.17g"
    row = ",".join(["%.17g", *[digits] * len(names)]) + "\n"
    part = first
    while part is not None:
        for time, values in zip(part.timestamps.tolist(), part.values.reshape(len(part), -1).tolist()):
            pipe.write((row % (time, *values)).encode())
        part = next(parts, None)
