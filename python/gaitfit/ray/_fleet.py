"""Fits of many robots alike, each on a worker, and what they show together."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import _gaitfit
from .. import _given as given
from .._arguments import count, items, mapping, path, text
from .._fleet import fleet as together
from .._given import PathLike, Resume, Settings
from .._hierarchy import MIN_ROBOTS
from .._logs import Log
from .._progress import Progresses, listener
from ..config import Cost, Fit
from ..results import Fleet
from ._cluster import Cluster, Place
from ._limit import Limit
from ._orders import Order, Orders, silent


def fleet(
    robots: Mapping[str, PathLike | Log | Sequence[PathLike | Log]],
    config: PathLike | Fit | None = None,
    *,
    robot: PathLike | None = None,
    policy: PathLike | None = None,
    costs: Cost | Sequence[Cost] | None = None,
    settings: Settings | None = None,
    fits: int = 1,
    name: str = "fleet",
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    progress: Progresses = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
    every: float = 20.0,
) -> Fleet:
    """Fits robots alike, each on a worker of a Ray cluster, and returns what the fits show together (:func:`gaitfit.fleet`).

    Arguments:
        robots: For each robot, by its name, its logs as for :func:`gaitfit.fit`. At least 4 robots.
        config, robot, policy, costs, settings: As for :func:`gaitfit.fit`, the same for all; ``policy`` is a file.
        fits: Fits of each robot, each to a part of its logs. Two or more calibrate the intervals (:func:`gaitfit.fleet`).
        name: Folder of the robots' run folders; ``fleet.json`` in it is the result, which :func:`gaitfit.load` reads.
        runs: Folder of that folder; by default ``"runs"``.
        resume, progress: As for :func:`gaitfit.fit`; a step of progress is a robot.
        max_seconds: Wall time of the call, s; after it the call stops with :class:`Stopped`. It keeps the finished robots, and what the
            workers sent for the others. ``resume=True`` continues.
        address, num_cpus, num_gpus, retries: As for :func:`gaitfit.ray.fit`, for each robot.
        every: Time between checkpoints that a worker sends, s.

    Every fit has the same bits as :func:`gaitfit.fit` on one machine. A worker fetches only the files of its robot.
    Another node continues a lost worker's fit, and ``resume=True`` continues after this process was killed.

    Raises as :func:`gaitfit.fit` and :func:`gaitfit.fleet`. Logs that cannot be used are an error before the first fit.

    >>> logs = {name: f"logs/{name}" for name in ("a", "b", "c", "d")}      # doctest: +SKIP
    >>> fleet = gaitfit.ray.fleet(logs, "go2.toml", address="auto")      # doctest: +SKIP
    """
    limit, place, listen = Limit(max_seconds), Place(num_cpus, num_gpus, retries), listener(progress) or silent
    several = mapping("robots", robots, '{"robot-1": "logs/robot-1"}')
    if len(several) < MIN_ROBOTS:
        raise ValueError(f"there are {len(several)} robots; the scatter of a fleet needs at least {MIN_ROBOTS}")
    folder = os.path.join(os.path.relpath(path("runs", "runs" if runs is None else runs)), text("name", name))
    if not isinstance(config, Fit):
        config = _seen("config", config)
    common = (_seen("robot", robot), _seen("policy", policy))
    cluster = Cluster(address, place)
    orders: dict[str, list[Order]] = {}
    for one, logs in several.items():
        if one in ("", ".", "..") or os.sep in one:
            raise ValueError(f"a robot's name is {one!r}; it must be a name for a folder")
        orders[one] = []
        for number, part in enumerate(_parts(one, _logs(logs), count("fits", fits, 1)), 1):
            whose = one if fits == 1 else f"{one}-{number}"
            others = given.fit_settings(part, *common, costs, settings, folder)

            def run(resume: Resume, threads: int | None, device: str) -> dict[str, Any]:
                return given.run(config, Fit, others, whose, resume, threads, device)

            where, files = _gaitfit.adapt_plan(run(resume, None, "cpu"))
            how = {"what": "fit", "run": run(True, place.threads, place.device)}
            orders[one].append(Order(whose, os.fspath(where), [], how, [os.fspath(file) for file in files]))
    makes = Orders(cluster, {}, every, listen, limit, folder)
    makes.make([order for own in orders.values() for order in own])
    found = together({one: [order.folder for order in own] for one, own in orders.items()})
    found.write(os.path.join(folder, "fleet.json"))
    return found


def _seen(what: str, file: PathLike | None) -> str | None:
    """A path as seen from the current folder, which workers have an image of."""
    return None if file is None else os.path.relpath(path(what, file))


def _parts(robot: str, logs: list[Any], fits: int) -> list[list[Any]]:
    """The logs of a robot for each of its fits, in turn; folders are split into their files."""
    if fits == 1:
        return [logs]
    files: list[Any] = []
    for one in logs:
        inside = sorted(Path(one).glob("*.csv")) if isinstance(one, str) and os.path.isdir(one) else [one]
        files += [os.fspath(file) if isinstance(file, Path) else file for file in inside]
    if len(files) < fits:
        raise ValueError(f"the robot {robot} has {len(files)} logs, and fits is {fits}: each fit needs a log of its own")
    return [files[number::fits] for number in range(fits)]


def _logs(logs: Any) -> list[Any]:
    """Logs with their paths as seen from the current folder."""
    several = [logs] if isinstance(logs, (str, os.PathLike, Log)) or hasattr(logs, "columns") else items("logs", logs, "paths or logs")
    return [os.path.relpath(one) if isinstance(one, (str, os.PathLike)) else one for one in several]
