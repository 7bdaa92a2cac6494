"""Work that a worker does in a folder of its own: what it needs goes there, and what it writes comes back as it goes on.

The worker's folder is an image of the driver's: its current folder lies there under the same path, so that relative paths,
also those in files, are the same on both sides.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

#: Files of a run by their paths in it.
Files = Mapping[str, bytes]
#: Files that only grow: they are read last and written first, so that they never lack what others speak of.
GROWING = (".jsonl", ".gaitfit")
#: Files that say that others are complete.
LAST = ("seed.json", "result.json")
#: How often a folder that changes all the time is read again before it is left for later.
TRIES = 5


def image(root: str, folder: str, path: str) -> Path:
    """Where ``path``, seen from the driver's ``folder``, lies in the image ``root``."""
    return Path(root + os.path.normpath(os.path.join(folder, path)))


def write(folder: Path, files: Files) -> None:
    """Writes files, each whole or not at all."""
    def rank(name: str) -> int:
        return 0 if name.endswith(GROWING) else 2 if os.path.basename(name) in LAST else 1

    for name in sorted(files, key=lambda name: (rank(name), name)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".writing-", delete=False) as file:
            file.write(files[name])
            file.flush()
            os.fsync(file.fileno())
        os.chmod(file.name, 0o644)
        os.replace(file.name, path)


def read(folder: Path) -> dict[str, bytes]:
    """The files below a folder; none if it is not there."""
    return Changes(folder).take() or {}


class Changes:
    """What changes in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[int, int]] = {}

    def _look(self) -> dict[str, tuple[int, int]]:
        found = {}
        for at, _, names in os.walk(self._folder):
            for name in names:
                if name == ".lock" or name.startswith(".writing-"):
                    continue
                path = os.path.join(at, name)
                try:
                    status = os.stat(path)
                except FileNotFoundError:
                    continue
                if ".writing-" not in os.path.relpath(at, self._folder):
                    found[os.path.relpath(path, self._folder)] = (status.st_mtime_ns, status.st_size)
        return found

    def take(self) -> dict[str, bytes] | None:
        """Files that are new or other than when they were taken last; ``None`` while too much changes."""
        for _ in range(TRIES):
            seen = self._look()
            changed = [name for name, status in seen.items() if self._known.get(name) != status]
            growing = [name for name in changed if name.endswith(GROWING)]
            others = {name: (self._folder / name).read_bytes() for name in changed if name not in growing}
            # Files that go together are taken together.
            if all(self._look().get(name) == seen[name] for name in others):
                grown = {name: (self._folder / name).read_bytes() for name in growing}
                self._known = seen
                return {**others, **grown}
        return None


def done(
    work: Callable[[Callable[..., None]], Any], folder: Path, every: float, stop: threading.Event
) -> Iterator[dict[str, bytes]]:
    """Does ``work(progress)`` on a thread; every so many seconds what changed in ``folder``, and at the end the rest."""
    failure: list[BaseException] = []

    def progress(*_event: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    def body() -> None:
        try:
            work(progress)
        except BaseException as error:  # noqa: BLE001
            failure.append(error)

    changes = Changes(folder)
    # What the folder has already the driver has too.
    changes.take()
    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    last = time.monotonic()
    try:
        while thread.is_alive():
            thread.join(0.1)
            if thread.is_alive() and time.monotonic() - last >= every:
                taken = changes.take()
                last = time.monotonic()
                if taken:
                    yield taken
    finally:
        stop.set()
        thread.join()
    rest = changes.take()
    if rest:
        yield rest
    if failure:
        raise failure[0]
