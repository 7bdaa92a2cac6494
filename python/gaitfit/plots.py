"""Charts for notebooks. Needs ``matplotlib`` (``pip install "gaitfit[plot]"``). Each function returns the figure, and raises ``ValueError`` for
results without what its chart shows.

>>> log(gaitfit.read_log("examples/go2-demo/fit.csv")[:200], ["FL_hip"]).savefig("log.png")      # doctest: +SKIP
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._needs import lacking

try:
    import matplotlib.pyplot as plt
except ImportError as missing:
    raise lacking("plots", "plot", missing) from missing
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ._arguments import items
from ._logs import Log
from .results import Fleet, Result

if TYPE_CHECKING:
    from ._own_simulator import FitOutcome
else:
    from ._hints import FitOutcome

__all__ = ["convergence", "drift", "fleet", "log", "parameters", "plot", "training"]

#: What a stage returned, or its document.
Shown = Result | Mapping[str, Any]


def plot(results: Shown) -> Figure:
    """The chart of ``results``: a fit's :func:`parameters`, an evaluation's :func:`drift`, a training's
    :func:`training`, a :func:`fleet`, and of a loop the fit of its last round.

    Returns the figure. Raises ``ValueError`` for results without a chart.

    >>> figure = plot(result)
    """
    if isinstance(results, Fleet):
        return fleet(results)
    results = _document(results)
    if results.get("parameters"):
        return parameters(results)
    if results.get("rounds"):
        return parameters(_rows(results, "rounds", "of a loop")[-1].get("adapt") or {})
    if results.get("drift"):
        return drift(results)
    if results.get("seeds"):
        return training(results)
    raise ValueError(f"there is no chart of results with {', '.join(results)}: plot its rows with matplotlib")


def parameters(found: Shown | FitOutcome, axes: Axes | None = None) -> Figure:
    """Each parameter of ``found``, a fit's result, between its bounds, with its numbers: the estimate, its 95 % interval, and the
    truth where it is known. ``axes`` are drawn in where they are given, else a new figure.

    Returns the figure. Raises ``ValueError`` for results without parameters.

    >>> figure = parameters(result)
    """
    if isinstance(found, (Result, Mapping)):
        rows: Sequence[Mapping[str, Any]] = _rows(
            found, "parameters", "of a fit", ("name", "value", "unit", "lower", "upper")
        )
    elif hasattr(found, "rows"):
        rows = _parameters(found)
    else:
        raise TypeError(f"found is a {type(found).__name__}; give what a fit returned, or its document as a dict")
    figure, axes = _drawn(axes, (8.0, 0.6 + 0.34 * len(rows)))
    for at, row in enumerate(rows):
        interval = row.get("interval")
        lower, upper = row["lower"], row["upper"]
        width = (upper - lower) or 1.0
        axes.plot([0, 1], [at, at], color="0.85", linewidth=6, solid_capstyle="butt", zorder=1)
        if interval:
            ends = [(end - lower) / width for end in interval]
            axes.plot(ends, [at, at], color="tab:blue", alpha=0.4, linewidth=6, solid_capstyle="butt", zorder=2)
        if row.get("truth") is not None:
            axes.plot((row["truth"] - lower) / width, at, "|", color="black", markersize=14, zorder=3)
        axes.plot((row["value"] - lower) / width, at, "o", color="tab:blue", zorder=4)
        unit = "" if row["unit"] in ("", "-") else f" {row['unit']}"
        around = f" ({interval[0]:.3g} … {interval[1]:.3g})" if interval else ""
        axes.annotate(f"{row['value']:.4g}{around}{unit}", (1.02, at), va="center", fontsize=9)
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axes.set_xlim(-0.02, 1.5)
    axes.set_xticks([0, 1], ["lower bound", "upper bound"])
    axes.invert_yaxis()
    axes.spines[["top", "right", "left"]].set_visible(False)
    if any(row.get("truth") is not None for row in rows):
        axes.set_title("found (dot), truth (line)", fontsize=10)
    return figure


def fleet(found: Fleet) -> Figure:
    """Each number of the robots of ``found`` over the fleet's center: the estimate of a robot's own logs (open), the one with
    the other robots (filled), and the range of 95 % of such robots. Numbers that may be negative are left out.

    Returns the figure. Raises ``TypeError`` for what is no fleet, and ``ValueError`` without positive numbers.

    >>> figure = fleet(gaitfit.load("runs/fleet/fleet.json"))      # doctest: +SKIP
    """
    numbers = [one for one in found.numbers.values() if one.scale == "relative"]
    if not numbers:
        raise ValueError("the fleet has no positive numbers: plot its rows with matplotlib")
    figure, axes = plt.subplots(figsize=(7.0, 0.6 + 0.34 * len(numbers)), layout="constrained")
    for at, number in enumerate(numbers):
        ends = [end / number.center for end in number.another]
        axes.plot(ends, [at, at], color="0.85", linewidth=6, solid_capstyle="butt", zorder=1)
        own = [robot[number.name] for robot in found.robots.values()]
        axes.plot([one.alone / number.center for one in own], [at] * len(own), "o", mfc="none", color="0.4", zorder=2)
        axes.plot([one.value / number.center for one in own], [at] * len(own), ".", color="tab:blue", zorder=3)
    axes.set_yticks(range(len(numbers)), [one.name for one in numbers])
    axes.set_xlabel("over the fleet's center")
    axes.invert_yaxis()
    axes.spines[["top", "right", "left"]].set_visible(False)
    return figure


def convergence(results: Shown, axes: Axes | None = None) -> Figure:
    """The smallest cost so far of each seed, generation by generation; ``results`` are of a fit with a run folder, and ``axes`` are
    drawn in where they are given.

    Returns the figure. Raises ``ValueError`` for results without a run folder.

    >>> figure = convergence(result)
    """
    lines = _metrics(results)
    figure, axes = _drawn(axes, (7.0, 3.5))
    for cost, seed in sorted({(line["cost"], line["seed"]) for line in lines}):
        run = [line for line in lines if (line["cost"], line["seed"]) == (cost, seed)]
        axes.plot([line["generation"] for line in run], [line["best_so_far"] for line in run], label=f"{cost}, seed {seed}")
    axes.set(xlabel="generation", ylabel="smallest cost so far", yscale="log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()
    return figure


def training(results: Shown, axes: Sequence[Axes] | None = None) -> Figure:
    """Reward and velocity errors of each seed, iteration by iteration; ``results`` are of a training. Two ``axes``, for rewards and
    errors, are drawn in where they are given.

    Returns the figure. Raises ``ValueError`` for results of something else.

    >>> figure = training(trained)
    """
    pair: list[Axes] = list(plt.subplots(1, 2, figsize=(9.0, 3.5), layout="constrained")[1] if axes is None else axes)
    if len(pair) != 2:
        raise ValueError(f"there are {len(pair)} axes; give two, for rewards and errors")
    figure = _figure(pair[0])
    for seed in _rows(results, "seeds", "of a training", ("seed", "policy")):
        lines = _lines(Path(seed["policy"]).parent / "metrics.jsonl")
        iterations = [line["iteration"] for line in lines]
        pair[0].plot(iterations, [line["reward"] for line in lines], label=f"seed {seed['seed']}")
        pair[1].plot(iterations, [line["linear_velocity_error"] for line in lines], label="|v − c|, m/s")
        pair[1].plot(iterations, [line["angular_velocity_error"] for line in lines], label="|ω − c|, rad/s")
    pair[0].set(xlabel="iteration", ylabel="reward of a control step")
    pair[1].set(xlabel="iteration")
    for one in pair:
        one.xaxis.set_major_locator(MaxNLocator(integer=True))
        one.legend()
    return figure


def drift(results: Shown) -> Figure:
    """The paths of the first robots under constant commands, seen from above, m; ``results`` are of an evaluation.

    Returns the figure. Raises ``ValueError`` for results without such trials.

    >>> figure = drift(walked)
    """
    figure, axes = plt.subplots(figsize=(5.0, 5.0), layout="constrained")
    for trial in _rows(results, "drift", "of an evaluation with drift", ("name", "path")):
        path = np.asarray(trial["path"], float)
        if len(path):
            axes.plot(path[:, 0], path[:, 1], label=trial["name"])
    axes.set(xlabel="ahead, m", ylabel="to the left, m", aspect="equal")
    axes.legend(fontsize=8)
    return figure


def log(log: Log, joints: Sequence[str] | None = None) -> Figure:
    """Position and target, rad, of some joints of a log over time, s; without ``joints`` of its first three.

    Returns the figure. Raises ``ValueError`` for a joint that the log does not have.

    >>> figure = log(gaitfit.read_log("examples/go2-demo/fit.csv"), ["FL_hip"])
    """
    if not isinstance(log, Log):
        raise TypeError(f"log is a {type(log).__name__}; give a gaitfit.Log, for example of gaitfit.read_log")
    if np.ndim(log.position) != 2:
        raise ValueError(f"position has the shape {np.shape(log.position)}; needed: samples × joints")
    names = list(log.joints or [str(number) for number in range(np.asarray(log.position).shape[1])])
    chosen = names[:3] if joints is None else items("joints", joints, "joints' names")
    unknown = [name for name in chosen if name not in names]
    if unknown:
        raise ValueError(f"the log has no joint {unknown[0]!r}; it has {', '.join(names)}")
    position = np.asarray(log.position)
    time = np.arange(len(position)) * (log.dt or 1.0) if log.time is None else np.asarray(log.time)
    figure, axes = plt.subplots(len(chosen), 1, figsize=(8.0, 1.8 * len(chosen)), sharex=True, squeeze=False, layout="constrained")
    for name, (one,) in zip(chosen, axes):
        column = names.index(name)
        if log.target is not None:
            one.plot(time, np.asarray(log.target)[:, column], color="0.6", linewidth=1, label="target")
        one.plot(time, position[:, column], linewidth=1, label="position")
        one.set_ylabel(f"{name}, rad", fontsize=8)
    axes[0, 0].legend(loc="upper right", fontsize=8)
    axes[-1, 0].set_xlabel("time, s" if log.time is not None or log.dt else "sample")
    return figure


def _drawn(axes: Axes | None, size: tuple[float, float]) -> tuple[Figure, Axes]:
    """The user's axes and their figure, or new ones."""
    if axes is None:
        figure, axes = plt.subplots(figsize=size, layout="constrained")
        return figure, axes
    return _figure(axes), axes


def _figure(axes: Axes) -> Figure:
    found: Any = getattr(axes, "figure", None)
    while hasattr(found, "figure") and not isinstance(found, Figure):
        # Of a part of a figure.
        found = found.figure
    if not isinstance(found, Figure):
        raise TypeError(f"axes is {axes!r}; give axes of matplotlib, for example of plt.subplots")
    return found


def _document(results: object) -> Mapping[str, Any]:
    if isinstance(results, Result):
        return results.document
    if not isinstance(results, Mapping):
        raise TypeError(f"results is a {type(results).__name__}; give what a stage returned, or its document as a dict")
    return results


def _rows(results: Shown, key: str, whose: str, fields: Sequence[str] = ()) -> list[Mapping[str, Any]]:
    results = _document(results)
    rows = results.get(key)
    if not isinstance(rows, Sequence) or not all(isinstance(row, Mapping) for row in rows):
        raise ValueError(f"these results have no {key}, which the chart {whose} shows; they have {', '.join(results)}")
    for row in rows:
        missing = [field for field in fields if row.get(field) is None]
        if missing:
            raise ValueError(f"a row of {key} has no {missing[0]}, which the chart {whose} shows; it has {', '.join(row)}")
    return list(rows)


def _parameters(found: FitOutcome) -> list[dict[str, Any]]:
    return [{**row, "interval": (found.intervals or {}).get(row["name"])} for row in found.rows()]


def _metrics(results: Shown) -> list[dict[str, Any]]:
    folder = _document(results).get("run_folder")
    path = None if folder is None else Path(folder) / "metrics.jsonl"
    if path is None or not path.exists():
        raise ValueError("these results have no run folder with metrics: they are not of a fit, or it was removed")
    return _lines(path)


def _lines(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        raise ValueError(f"there is no {path}: the run folder was moved or removed; charts of a run need it")
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
