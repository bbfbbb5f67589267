"""The command: `python -m dermatome`."""

import sys

from dermatome._dermatome import run_command


def main() -> int:
    """Run the command with the arguments of this process, and return its exit code."""
    return run_command(["dermatome", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
