"""A limit on the time of a call."""

from __future__ import annotations

import time

from .. import _gaitfit
from .._arguments import time_limit


#: How to continue.
CONTINUE = "Repeat the call to continue; a fleet or a training needs resume=True"
#: The end of the message of a stopped call: what is kept, and how to continue.
KEPT = f"The run_folder keeps what the workers sent. {CONTINUE}"


class Limit:
    """How long a call may take, s. This includes the time to reach the cluster. ``None``: there is no limit."""

    def __init__(self, max_seconds: float | None) -> None:
        self._max, self._begun = time_limit(max_seconds), time.monotonic()

    def left(self) -> float | None:
        """The time that is left, s. It is always above 0, because a stage refuses 0."""
        return None if self._max is None else round(max(self._max - (time.monotonic() - self._begun), 0.001), 3)

    def check(self) -> None:
        """Raises :class:`gaitfit.Stopped` when the time is over."""
        if self._max is not None and time.monotonic() - self._begun >= self._max:
            raise _gaitfit.Stopped(f"stopped after {self._max:g} s (max_seconds). {KEPT}")
