"""`python -m benchmarks`."""

import sys

from benchmarks import exit_codes


def _start() -> int:
    """Load the command line, which takes a second, and run it."""
    try:
        from benchmarks.cli import main
    except ModuleNotFoundError as error:
        print(f"refused: {error.name} is not installed: make setup, or pip install --editable '.[bench]'")
        return exit_codes.REFUSED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C")
        return exit_codes.INTERRUPTED
    return main()


sys.exit(_start())
