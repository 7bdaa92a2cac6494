"""Objects that one thread uses at a time."""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import contextmanager


class Alone:
    """A lock that does not wait: a second thread gets an error that names what to do."""

    def __init__(self, what: str) -> None:
        self._what, self._lock = what, threading.Lock()

    @contextmanager
    def __call__(self) -> Generator[None, None, None]:
        if not self._lock.acquire(blocking=False):
            raise RuntimeError(f"two threads use the same {self._what} at once: give each thread one of its own, or a lock")
        try:
            yield
        finally:
            self._lock.release()
