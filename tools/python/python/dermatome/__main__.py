"""The command: `python -m dermatome`."""

import sys
from typing import Any

from dermatome._dermatome import run_command


def main() -> int:
    """Run the command with the arguments of this process, and return its exit code.

    Zarr, LeRobot, HDF5 and bags are read here, and so are drafts of their layouts.
    """
    return run_command(["dermatome", *sys.argv[1:]], _opened, _drafted)


# Most commands read no recording, and start without what reads them.
def _opened(*asked: Any) -> Any:
    from dermatome.recordings.command import opened

    return opened(*asked)


def _drafted(*asked: Any) -> Any:
    from dermatome.recordings.command import drafted

    return drafted(*asked)


if __name__ == "__main__":
    sys.exit(main())
