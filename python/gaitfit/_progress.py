"""Progress of a stage: events, on standard error or wherever the caller likes."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

Kind = Literal["note", "stage", "output", "begin", "step", "end"]


@dataclass(frozen=True)
class Event:
    """What a stage reports to its ``progress`` function. The function may return ``False``: then the stage stops, keeps what is
    done, and raises :class:`gaitfit.Stopped`.

    Attributes:
        kind: ``"note"``: something worth knowing. ``"stage"``: a stage of a loop begins. ``"output"``: a line of a program that
            a loop runs. ``"begin"``, ``"step"`` and ``"end"``: countable work.
        text: The note, the stage, the line, or for a step how good the result is so far, in words.
        what: What is counted, for example ``"generation"`` of a fit, ``"seed 1, iteration"`` of a training, or
            ``"random commands: simulated second"`` of an evaluation.
        done: How many are done; of ``"begin"`` those before this run, where it continues one, of ``"end"`` the last step's.
        total: How many there are; work whose result is certain earlier ends before.
        seed: The seed that ``"begin"``, ``"step"`` and ``"end"`` of a training belong to; ``None`` for other work. A fit searches with all
            its seeds in the same generations, so the names of its ``metrics`` contain the seed.
        metrics: Numbers of a step by name. Of a fit, for each cost and seed: ``"wass/seed-1/best_so_far"``, ``best``, ``mean``,
            ``sigma``, ``diverged`` and ``fallen``. Of a training: ``"train/reward"``, ``train/episode_return``,
            ``train/episode_seconds``, ``train/fall_rate``, ``train/linear_velocity_error`` and
            ``train/angular_velocity_error``; each reward term, such as ``"reward/torque"``; of the learner ``"ppo/kl"``,
            ``ppo/policy_loss``, ``ppo/value_loss``, ``ppo/mean_std``, ``ppo/learning_rate`` and more; and
            ``"speed/samples_per_second"``.

    >>> Event("step", what="generation", done=3, total=200, metrics={"wass/seed-1/best_so_far": 0.2}).done
    3
    """

    kind: Kind
    text: str = ""
    what: str = ""
    done: int = 0
    total: int = 0
    metrics: Mapping[str, float] = field(default_factory=dict)
    seed: int | None = None


#: What takes events: ``False`` stops the stage, every other answer continues.
Progress = Callable[[Event], object]
#: What ``progress=`` takes.
Progresses = bool | Progress | Sequence[Progress | Literal[True]]
#: What the native half calls: kind, text, done, total, numbers and the seed.
Listener = Callable[[Kind | Literal["metrics"], str, int, int, Mapping[str, float], int | None], bool]


def listener(progress: Progresses) -> Listener | None:
    """The function to which the native half reports: ``True`` prints, also among others; with ``False`` there is none."""
    if isinstance(progress, bool):
        return _Reported([Printed()]) if progress else None
    given = [progress] if callable(progress) else progress
    several = [Printed() if one is True else one for one in given] if isinstance(given, (list, tuple)) else [None]
    functions = [one for one in several if callable(one)]
    if len(functions) < len(several):
        raise TypeError(
            f"progress is {progress!r}; give True, False, a function of a gaitfit.Event, or a list of functions, in which True "
            "prints"
        )
    return _Reported(functions)


class _Reported:
    """Makes events of what the native half reports."""

    def __init__(self, listeners: Sequence[Progress]) -> None:
        self._listeners = listeners
        self._what, self._done, self._total = "", 0, 0
        self._metrics: Mapping[str, float] = {}
        self._seed: int | None = None

    def __call__(
        self,
        kind: Kind | Literal["metrics"],
        text: str,
        done: int,
        total: int,
        metrics: Mapping[str, float],
        seed: int | None,
    ) -> bool:
        if kind == "metrics":
            # They belong to the step that follows.
            self._metrics = metrics
            return True
        if kind == "begin":
            self._what, self._total, self._seed = text, total, seed
        counted = kind in ("begin", "step", "end")
        self._done = self._done if kind not in ("begin", "step") else done
        event = Event(
            kind,
            "" if kind == "begin" else text,
            self._what if counted else "",
            self._done if counted else 0,
            self._total if counted else 0,
            self._metrics if kind == "step" else {},
            self._seed if counted else None,
        )
        if kind == "step":
            self._metrics = {}
        # Each gets the event, also if one of them stops.
        answers = [one(event) for one in self._listeners]
        return not any(answer is False for answer in answers)


_BAR = 24


class Printed:
    """Prints notes as lines. Countable work is a bar that is written over; where there is neither a terminal nor a notebook
    it is a line every five seconds.

    >>> lines = Printed()
    >>> trained = gaitfit.train("train.toml", progress=[lines, bar])      # doctest: +SKIP
    """

    def __init__(self) -> None:
        self._shown, self._wide = 0.0, 0
        #: The last step, while it is not shown.
        self._hidden: Event | None = None
        self._over = sys.stderr.isatty() or "ipykernel" in sys.modules

    def __call__(self, event: Event) -> None:
        """Prints one event."""
        if event.kind == "begin":
            self._shown, self._wide, self._hidden = 0.0, 0, None
        elif event.kind == "step":
            now, self._hidden = time.monotonic(), event
            if now - self._shown > (0.1 if self._over else 5.0) or event.done == event.total:
                self._shown, self._hidden = now, None
                self._print(event)
        elif event.kind == "end":
            if self._hidden is not None:
                # Work may end before its total.
                self._print(self._hidden)
                self._shown, self._hidden = 1.0, None
            if self._over and self._shown:
                print(file=sys.stderr, flush=True)
            self._shown = 0.0
        else:
            mark = {"note": "note: ", "output": "  "}.get(event.kind, "")
            print(f"{mark}{event.text}", file=sys.stderr, flush=True)

    def _print(self, event: Event) -> None:
        line = f"{event.what} {event.done} of {event.total}  {event.text}"
        if not self._over:
            print(line, file=sys.stderr, flush=True)
            return
        full = _BAR * event.done // max(event.total, 1)
        line = f"[{'=' * full}{' ' * (_BAR - full)}] {line}"
        if sys.stderr.isatty():
            line = line[: shutil.get_terminal_size().columns - 1]
        # Notebooks know no code that clears a line.
        line, self._wide = line.ljust(self._wide), len(line)
        print(f"\r{line}", end="", file=sys.stderr, flush=True)
