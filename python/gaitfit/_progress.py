"""Progress of a stage on standard error, or wherever the caller likes."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable

Progress = Callable[[str, str, int, int], None]


def listener(progress: bool | Progress) -> Progress | None:
    """The function that a stage tells its events: ``True`` prints them, ``False`` nobody hears them."""
    if callable(progress):
        return progress
    if not isinstance(progress, bool):
        raise TypeError(f"progress is {progress!r}; give True, False or a function of (kind, text, done, total)")
    return _Printed() if progress else None


_BAR = 24


class _Printed:
    """Notes as lines; countable work as a bar that is written over, or elsewhere than on terminals and in notebooks as a
    line once in a while."""

    def __init__(self) -> None:
        self._what, self._total, self._shown, self._wide = "", 0, 0.0, 0
        self._over = sys.stderr.isatty() or "ipykernel" in sys.modules

    def __call__(self, kind: str, text: str, done: int, total: int) -> None:
        if kind == "begin":
            self._what, self._total, self._shown, self._wide = text, total, 0.0, 0
        elif kind == "step":
            now = time.monotonic()
            if now - self._shown > (0.1 if self._over else 5.0) or done == self._total:
                self._shown = now
                line = f"{self._what} {done} of {self._total}  {text}"
                if self._over:
                    full = _BAR * done // max(self._total, 1)
                    line = f"[{'=' * full}{' ' * (_BAR - full)}] {line}"
                    if sys.stderr.isatty():
                        line = line[: shutil.get_terminal_size().columns - 1]
                    # Notebooks know no code that clears a line.
                    line, self._wide = line.ljust(self._wide), len(line)
                print(f"\r{line}" if self._over else line, end="" if self._over else "\n", file=sys.stderr, flush=True)
        elif kind == "end":
            if self._over and self._shown:
                print(file=sys.stderr, flush=True)
            self._shown = 0.0
        else:
            mark = {"note": "note: ", "output": "  "}.get(kind, "")
            print(f"{mark}{text}", file=sys.stderr, flush=True)
