"""The command: `python -m dermatome`."""

import sys
from typing import Any

from dermatome._dermatome import run_command


def main() -> int:
    """Run the command with the arguments of this process, and return its exit code.

    Zarr, LeRobot, HDF5 and bags are read here, and so are drafts of their layouts.
    """
    args = sys.argv[1:]
    words = [k for k, each in enumerate(args) if not each.startswith("-")]
    if words and args[words[0]] == "layout":
        from dermatome.recordings.command import draft

        code = draft(args[words[0] + 1 :])
        if code is not None:
            return code
    return run_command(["dermatome", *args], _opened)


def _opened(*asked: Any) -> Any:
    # Most commands read no recording, and start without what reads them.
    from dermatome.recordings.command import opened

    return opened(*asked)


if __name__ == "__main__":
    sys.exit(main())
