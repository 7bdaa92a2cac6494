"""What workers do, and what they keep from task to task."""

# Without Ray this folder is what a checker finds by that name.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
import platform
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

from .. import _gaitfit
from ._parts import done, image, write

#: The fits that this process has open, the last one last.
_open: dict[tuple[str, int, str], _gaitfit.Helper] = {}
#: Most fits that are kept open.
MAX_OPEN = 2


def helper(key: str, parcel: list[Any], threads: int, device: str) -> _gaitfit.Helper:
    """What simulates the fit ``key``; ``parcel`` holds the reference of what it needs."""
    import ray
    from ray import cloudpickle

    which = (key, threads, device)
    found = _open.pop(which, None)
    if found is None:
        while len(_open) >= MAX_OPEN:
            _open.pop(next(iter(_open)))
        needed, policy = ray.get(parcel[0])
        own = cloudpickle.loads(policy).native() if policy else None
        found = _gaitfit.Helper(needed, threads, device, own)
    _open[which] = found
    return found


def simulated(key: str, parcel: list[Any], threads: int, device: str, task: bytes) -> tuple[str, str, bytes, float]:
    """Does a task of a fit: who did it, what its robot costs where the search begins, the answer, and the time it took, s."""
    begun = time.monotonic()
    found = helper(key, parcel, threads, device)
    try:
        answer = found.work(task)
    except BaseException:
        # A policy's function that failed once is not asked again.
        _open.pop((key, threads, device), None)
        raise
    return f"{platform.node()} (process {os.getpid()})", found.mark, answer, time.monotonic() - begun


def made(
    here: str,
    sources: list[Any],
    folders: Mapping[str, list[Any]],
    folder: str,
    how: Mapping[str, Any],
    every: float,
) -> Iterator[dict[str, bytes]]:
    """Makes a part in an image of the driver's folder ``here``; what it writes in ``folder``, as it goes on."""
    import ray

    with tempfile.TemporaryDirectory(prefix="gaitfit-") as root:
        home = image(root, here, ".")
        home.mkdir(parents=True)
        write(home, ray.get(sources[0]))
        for name, files in folders.items():
            image(root, here, name).mkdir(parents=True, exist_ok=True)
            write(image(root, here, name), ray.get(files[0]))
        before = os.getcwd()
        os.chdir(home)
        try:
            yield from done(lambda progress: _work(how, progress), image(root, here, folder), every, threading.Event())
        finally:
            os.chdir(before)


def _work(how: Mapping[str, Any], progress: Any) -> None:
    if how["what"] == "cell":
        _gaitfit.reproduce_part(how["request"], how["part"], progress)
    elif how["what"] == "fit":
        _gaitfit.adapt(how["run"], None, progress, None)
    elif how["what"] == "finetuning":
        _gaitfit.finetune(how["run"], how["world"], how["seeds"], None, progress)
    else:
        _gaitfit.train(how["run"], how["robot"], how["seeds"], None, progress)
