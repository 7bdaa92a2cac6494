"""Fits of a simulator of your own."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import MAX_POPULATION, MAX_SEEDS, count, finite, flag, items, maybe, path, text, time_limit
from ._arrays import numbers
from ._logs import Log
from ._progress import Progresses, listener

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    from ._hints import Figure

Signals = Mapping[str, ArrayLike]


class Simulator(Protocol):
    """What :func:`fit_simulator` calls: any function from candidates to signals.

    >>> def still(candidates):
    ...     zeros = np.zeros((len(candidates), 100, 12))
    ...     return [{"position": zeros, "velocity": zeros}]
    """

    def __call__(self, candidates: NDArray[np.float64], /) -> Sequence[Signals]:
        """Simulates ``candidates``, shape ``(candidates, parameters)``, in the parameters' own units.

        Returns one mapping for each log, in the logs' order, with ``position``, rad, ``velocity``, rad/s, and, if the
        logs have it, ``action``: each of shape ``(candidates, samples, joints)``, the samples being those of the log.
        A candidate that diverged has NaN.
        """
        ...


@dataclass(frozen=True)
class Parameter:
    """A number to search with :func:`fit_simulator`; all numbers are in ``unit``.

    Attributes:
        name: Its name.
        lower, upper: Its bounds.
        start: Where the search begins: the first mean. By default the middle of the range.
        deviation: The first standard deviation. By default a quarter of the range.
        unit: Its unit; ``"-"`` for a ratio.

    >>> Parameter("damping", 0.0, 2.0, unit="N·m·s/rad").upper
    2.0
    """

    name: str
    lower: float
    upper: float
    start: float | None = None
    deviation: float | None = None
    unit: str = "-"


@dataclass(frozen=True)
class FitOutcome:
    """The result of :func:`fit_simulator`.

    Attributes:
        values: The best candidate by name.
        cost: Its cost.
        spread: Standard deviation of the seeds' best values by name; ``None`` with one seed.
        intervals: By name the range, ``(lower, upper)``, in which the logs do not distinguish a value from the best one;
            ``None`` if it was not measured.
        at_bound: Names of values at a bound.
        document: The outcome as plain data, as JSON has it, with the run of each seed.

    >>> outcome = FitOutcome({"delay": 0.007}, 0.1, {"delay": None}, None, [], {})
    >>> outcome.values["delay"]
    0.007
    """

    values: dict[str, float]
    cost: float
    spread: dict[str, float | None]
    intervals: dict[str, tuple[float, float]] | None
    at_bound: list[str]
    document: dict[str, Any]

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.values.items())
        return f"FitOutcome(cost {self.cost:.4g}: {values})"

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each parameter, for ``pandas.DataFrame`` or ``polars.DataFrame``."""
        keys = ("name", "value", "unit", "spread", "lower", "upper", "start", "at_bound")
        rows = [{key: one[key] for key in keys} for one in self.document["parameters"]]
        for row in rows:
            if self.intervals is not None:
                row["interval_lower"], row["interval_upper"] = self.intervals[row["name"]]
        return rows

    def plot(self) -> Figure:
        """Each parameter between its bounds (:func:`gaitfit.plots.parameters`), for notebooks. Needs ``matplotlib``."""
        from .plots import parameters

        return parameters(self)


def fit_simulator(
    simulate: Simulator,
    logs: Log | Sequence[Log],
    parameters: Sequence[Parameter],
    *,
    joints: Sequence[str] | None = None,
    cost: Literal["wass", "matcho"] = "wass",
    seeds: Sequence[int] = (1,),
    generations: int = 200,
    population: int = 0,
    tolerance: float = 1e-4,
    skip: int = 0,
    checkpoint: str | os.PathLike[str] | None = None,
    intervals: bool = False,
    max_seconds: float | None = None,
    progress: Progresses = True,
) -> FitOutcome:
    """Searches the parameters with which a simulator of your own moves like the robot, by CMA-ES.

    Arguments:
        simulate: A :class:`Simulator`: it gets an array of shape ``(candidates, parameters)`` with the candidates of all seeds, and
            returns their signals on every log. It is called on the calling thread.
        logs: The logs that it is compared with.
        parameters: What is searched.
        joints: Names of the signals' columns; by default those of the first log.
        cost: ``"wass"`` (distributions: no common clock is needed) or ``"matcho"`` (sample by sample).
        seeds: One search each.
        generations: Largest number of generations of a search.
        population: Candidates a generation; 0 takes 4 + ⌊3 ln n⌋ for n parameters.
        tolerance: A search ends when its spread has shrunk to this share of its first spread.
        skip: Number of samples at the start of every log that do not count.
        checkpoint: A file that keeps the state after every generation. A later call with the same arguments continues the search,
            to the same bits.
        intervals: Whether to measure at the end how well the logs determine each value, with further simulations.
        max_seconds: Wall time after which the search ends with what it has, s; then intervals are not measured. A ``checkpoint``
            continues it.
        progress: As for :func:`fit`.

    Returns the best values with their costs and spreads.

    Raises ``ValueError`` for arrays of a wrong shape, :class:`GaitfitError` for a search that cannot continue, :class:`Stopped`
    if ``progress`` returned ``False``, and whatever ``simulate`` itself raises.

    >>> swing = np.sin(np.arange(50) / 5.0)[:, None]
    >>> log = gaitfit.Log.from_arrays(joints=["a"], dt=0.01, position=0.3 * swing, velocity=swing)
    >>> def scaled(candidates):
    ...     position = candidates[:, :, None] * swing
    ...     return [{"position": position, "velocity": np.broadcast_to(swing, position.shape)}]
    >>> result = fit_simulator(scaled, log, [Parameter("width", 0.0, 1.0)], cost="matcho", progress=False)
    >>> round(result.values["width"], 2)
    0.3
    """
    if not callable(simulate):
        raise TypeError(f"simulate is {simulate!r}; give a function from candidates to signals (gaitfit.Simulator)")
    logs = logs_of(logs)
    seeds = [count("a seed", seed, 0) for seed in items("seeds", seeds, "whole numbers")]
    if joints is None:
        joints = next((log.joints for log in logs if log.joints is not None), None)
    if joints is None:
        raise ValueError("the logs do not name their joints: give joints=[...], one name for each column")
    joints = [text("a name in joints", joint) for joint in items("joints", joints, "joints' names")]
    if any(log.joints is not None and list(log.joints) != joints for log in logs):
        raise ValueError(f"the logs' joints differ in names or order; needed in all of them: {joints}")
    if not 1 <= len(seeds) <= MAX_SEEDS:
        raise ValueError(f"seeds has {len(seeds)} elements; give 1 to {MAX_SEEDS}" if seeds else "seeds is empty: there must be at least one")
    entries = [_entry(one) for one in parameters_of(parameters)]
    if not entries:
        raise ValueError("parameters is empty: give at least one gaitfit.Parameter")
    tolerance = finite("tolerance", tolerance)
    if tolerance < 0:
        raise ValueError(f"tolerance is {tolerance}; it must be at least 0")
    recorded = [
        {name: _matrix(f"log {number}: {name}", getattr(log, name)) for name in ("position", "velocity", "action")}
        for number, log in enumerate(logs)
    ]

    def simulated(candidates: NDArray[np.float64]) -> list[dict[str, Any]]:
        found = simulate(candidates)
        if isinstance(found, (str, bytes, Mapping)) or not np.iterable(found):
            raise TypeError(f"simulate returned a {type(found).__name__}; needed: a list with one dict of arrays for each log")
        return [_signals(number, signals) for number, signals in enumerate(found)]

    search = {
        "cost": text("cost", cost),
        "skip": count("skip", skip, 0),
        "population": count("population", population, 0, MAX_POPULATION),
        "generations": count("generations", generations, 1),
        "seeds": seeds,
        "tolerance": tolerance,
        "checkpoint": maybe(path, "checkpoint", checkpoint),
        "intervals": flag("intervals", intervals),
        "max_seconds": time_limit(max_seconds),
    }
    found = _gaitfit.fit_simulator(simulated, joints, recorded, entries, search, listener(progress))
    document = json.loads(found)
    if document is None:
        raise _gaitfit.GaitfitError("no candidate had a finite cost: every simulation diverged")
    outcome = document["parameters"]
    ranges = {one["name"]: one.get("identification") for one in outcome}
    return FitOutcome(
        values={one["name"]: one["value"] for one in outcome},
        cost=document["best_cost"],
        spread={one["name"]: one.get("spread") for one in outcome},
        intervals={name: (one["lower"], one["upper"]) for name, one in ranges.items() if one} or None,
        at_bound=[one["name"] for one in outcome if one["at_bound"]],
        document=document,
    )


def logs_of(logs: Log | Sequence[Log]) -> list[Log]:
    """One log or several, as a list."""
    several = [logs] if isinstance(logs, Log) else items("logs", logs, "gaitfit.Log")
    for log in several:
        if not isinstance(log, Log):
            raise TypeError(f"logs has {log!r}; give gaitfit.Log, for example of gaitfit.read_log")
    if not several:
        raise ValueError("logs is empty: give at least one gaitfit.Log")
    return several


def parameters_of(parameters: Sequence[Parameter]) -> list[Parameter]:
    """The parameters as a list."""
    several = items("parameters", parameters, "gaitfit.Parameter")
    for one in several:
        if not isinstance(one, Parameter):
            raise TypeError(f"parameters has {one!r}; give gaitfit.Parameter(name, lower, upper)")
    return several


def _entry(one: Parameter) -> dict[str, Any]:
    """A parameter as the native half takes it."""
    name = text("a parameter's name", one.name)
    lower, upper = finite(f"lower of {name}", one.lower), finite(f"upper of {name}", one.upper)
    if lower >= upper:
        raise ValueError(f"lower of {name} is {lower} and upper {upper}; lower must be below upper")
    start = 0.5 * (lower + upper) if one.start is None else finite(f"start of {name}", one.start)
    if not lower <= start <= upper:
        raise ValueError(f"start of {name} is {start}; it must be from {lower} to {upper}, its bounds")
    deviation = 0.25 * (upper - lower) if one.deviation is None else finite(f"deviation of {name}", one.deviation)
    if deviation <= 0:
        raise ValueError(f"deviation of {name} is {deviation}; it must be above 0")
    unit = text(f"unit of {name}", one.unit)
    return {"name": name, "unit": unit, "lower": lower, "upper": upper, "start": start, "deviation": deviation}


def _matrix(what: str, values: ArrayLike | None) -> NDArray[np.float64] | None:
    if values is None:
        return None
    array = numbers(what, values, np.float64)
    if array.ndim != 2:
        raise ValueError(f"{what} has the shape {array.shape}; needed: samples × joints")
    return array


def _signals(number: int, signals: Signals) -> dict[str, Any]:
    if not isinstance(signals, Mapping):
        raise TypeError(f"simulate returned a {type(signals).__name__} for log {number}; needed: a dict of arrays")
    found: dict[str, Any] = {}
    for name in ("position", "velocity", "action"):
        values = signals.get(name)
        if values is None and name != "action":
            raise ValueError(f"simulate: the signals of log {number} have no {name!r}")
        found[name] = None if values is None else numbers(f"simulate: {name} of log {number}", values, np.float32)
        if values is not None and found[name].ndim != 3:
            shape = found[name].shape
            raise ValueError(f"simulate: {name} of log {number} has the shape {shape}; needed: candidates × samples × joints")
    return found
