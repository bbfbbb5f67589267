"""The command: `python -m dermatome`."""

import sys

from dermatome._dermatome import run_command
from dermatome.recordings.command import draft, opened


def main() -> int:
    """Run the command with the arguments of this process, and return its exit code.

    Zarr, LeRobot, HDF5 and bags are read here, and so are drafts of their layouts.
    """
    args = sys.argv[1:]
    words = [k for k, each in enumerate(args) if not each.startswith("-")]
    if words and args[words[0]] == "layout":
        code = draft(args[words[0] + 1 :])
        if code is not None:
            return code
    return run_command(["dermatome", *args], opened)


if __name__ == "__main__":
    sys.exit(main())
