"""The program ``gaitfit``, as the command that is installed and as ``python -m gaitfit``."""

from __future__ import annotations

import os
import sys

from ._gaitfit import program


def main() -> int:
    """Runs the program with the command line's arguments; its exit code."""
    return program([_own(), *sys.argv[1:]])


def _own() -> str:
    """What starts the program again: the command beside the interpreter, where it is not the one that was started."""
    called = os.path.abspath(sys.argv[0])
    return os.path.join(os.path.dirname(sys.executable), "gaitfit") if called.endswith(".py") else called


if __name__ == "__main__":
    sys.exit(main())
