"""The program ``gaitfit``, as the command that is installed and as ``python -m gaitfit``."""

from __future__ import annotations

import os
import signal
import sys

from ._gaitfit import program


def main() -> int:
    """Runs the program with the command line's arguments; its exit code."""
    # Python's handler only marks the interrupt, and the program runs no Python: without one Ctrl-C ends a command at once. Commands
    # that save first have their own.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return program([_own(), *sys.argv[1:]])


def _own() -> str:
    """What starts the program again: the command beside the interpreter, where it is not the one that was started."""
    called = os.path.abspath(sys.argv[0])
    return os.path.join(os.path.dirname(sys.executable), "gaitfit") if called.endswith(".py") else called


if __name__ == "__main__":
    sys.exit(main())
