"""The command: `python -m dermatome`."""

import sys

from dermatome._dermatome import run_command


def main() -> int:
    """Run the command with the arguments of this process, and return its exit code.

    `render` and `layout` of Zarr, LeRobot, HDF5 and bags are done here: the command reads what this gives it.
    """
    args = sys.argv[1:]
    if "render" in args or "layout" in args:
        from dermatome.recordings.command import run

        code = run(args)
        if code is not None:
            return code
    return run_command(["dermatome", *args])


if __name__ == "__main__":
    sys.exit(main())
