"""Ready-made functions for ``progress=``: tqdm, TensorBoard, Weights & Biases, MLflow. Each imports its package when it is made, and raises
``ImportError`` with the command that installs it.

Numbers have the names of :attr:`gaitfit.Event.metrics`. Those of a training begin with its seed: ``"seed-1/train/reward"``.

Several may be given: ``progress=[Tqdm(), WandB(project="go2")]``. A function of your own takes a :class:`gaitfit.Event` and may
return ``False`` to stop:

>>> from gaitfit import Event
>>> def enough(event: Event) -> bool:
...     return event.metrics.get("train/fall_rate", 1.0) > 0.01
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from importlib import import_module
from typing import Any


from ._progress import Event, Printed

__all__ = ["MLflow", "Printed", "TensorBoard", "Tqdm", "WandB"]


class Tqdm:
    """A bar of ``tqdm``; in notebooks its widget. Needs ``tqdm``.

    Arguments:
        options: What :class:`tqdm.tqdm` takes, for example ``leave=False``.

    >>> bar = Tqdm(leave=False)
    >>> trained = gaitfit.train("train.toml", progress=bar)      # doctest: +SKIP
    """

    def __init__(self, **options: Any) -> None:
        self._tqdm = _package("tqdm.auto", "tqdm", "Tqdm").tqdm
        self._options, self._bar = options, None

    def __call__(self, event: Event) -> None:
        """Shows one event."""
        if event.kind == "begin":
            self._bar = self._tqdm(total=event.total, initial=event.done, desc=event.what, **self._options)
        elif event.kind == "step" and self._bar is not None:
            self._bar.update(event.done - self._bar.n)
            self._bar.set_postfix_str(event.text, refresh=False)
        elif event.kind == "end" and self._bar is not None:
            self._bar.close()
            self._bar = None
        elif event.text:
            self._tqdm.write(event.text)


class TensorBoard:
    """Writes the numbers of each step as scalars. Needs ``tensorboard``. (Trainings also write their own event files into
    their run folders.)

    Arguments:
        folder: Where the event files go.

    >>> trained = gaitfit.train("train.toml", progress=TensorBoard("runs/board"))      # doctest: +SKIP
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        writer = _package("tensorboard.summary.writer.event_file_writer", "tensorboard", "TensorBoard")
        self._events = _package("tensorboard.compat.proto.event_pb2", "tensorboard", "TensorBoard")
        self._summaries = _package("tensorboard.compat.proto.summary_pb2", "tensorboard", "TensorBoard")
        self._writer = writer.EventFileWriter(os.fspath(folder))

    def __call__(self, event: Event) -> None:
        """Writes one event."""
        scalars = _named(event)
        if scalars:
            kind = self._summaries.Summary
            values = [kind.Value(tag=name, simple_value=value) for name, value in scalars.items()]
            self._writer.add_event(self._events.Event(step=event.done, wall_time=time.time(), summary=kind(value=values)))
        if event.kind == "end":
            self._writer.flush()


class WandB:
    """Logs the numbers of each step to Weights & Biases. Needs ``wandb``.

    Arguments:
        run: A run of ``wandb.init``; without one this begins one.
        options: What ``wandb.init`` takes, for example ``project="go2"``.

    >>> trained = gaitfit.train("train.toml", progress=WandB(project="go2"))      # doctest: +SKIP
    """

    def __init__(self, run: Any = None, **options: Any) -> None:
        self._run = _package("wandb", "wandb", "WandB").init(**options) if run is None else run

    def __call__(self, event: Event) -> None:
        """Logs one event."""
        scalars = _named(event)
        if scalars:
            # A training of several seeds counts each from 1, and the steps of a run of W&B only grow.
            self._run.log({**scalars, "done": event.done})


class MLflow:
    """Logs the numbers of each step to the active run of MLflow. Needs ``mlflow``.

    >>> with mlflow.start_run():      # doctest: +SKIP
    ...     trained = gaitfit.train("train.toml", progress=MLflow())
    """

    def __init__(self) -> None:
        self._mlflow = _package("mlflow", "mlflow", "MLflow")

    def __call__(self, event: Event) -> None:
        """Logs one event."""
        scalars = _named(event)
        if scalars:
            self._mlflow.log_metrics(dict(scalars), step=event.done)


def _named(event: Event) -> Mapping[str, float]:
    """The numbers of an event by name. A training puts the seed before each name, because all seeds have the same names."""
    before = "" if event.seed is None else f"seed-{event.seed}/"
    return {f"{before}{name}": value for name, value in event.metrics.items()}


def _package(module: str, package: str, who: str) -> Any:
    try:
        return import_module(module)
    except ImportError as missing:
        raise ImportError(f"gaitfit.callbacks.{who} needs {package}: pip install {package}") from missing
