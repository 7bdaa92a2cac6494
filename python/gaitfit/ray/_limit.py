"""A limit on the time of a call."""

from __future__ import annotations

import time

from .. import _gaitfit
from .._arguments import time_limit


#: What a stopped call leaves.
KEPT = "What the workers sent is in its run_folder: the same call continues, that of a fleet or a training with resume=True"


class Limit:
    """How long a call may take, s, with the time that it takes to reach the cluster; ``None``: as long as it needs."""

    def __init__(self, max_seconds: float | None) -> None:
        self._max, self._begun = time_limit(max_seconds), time.monotonic()

    def left(self) -> float | None:
        """The time that is left, s; always above 0, as a stage takes it."""
        return None if self._max is None else round(max(self._max - (time.monotonic() - self._begun), 0.001), 3)

    def check(self) -> None:
        """Raises :class:`gaitfit.Stopped` when the time is over."""
        if self._max is not None and time.monotonic() - self._begun >= self._max:
            raise _gaitfit.Stopped(f"stopped after {self._max:g} s (max_seconds). {KEPT}")
