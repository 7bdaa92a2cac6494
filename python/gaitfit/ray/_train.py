"""Trainings of several seeds, each on a worker."""

from __future__ import annotations

import os
from collections.abc import Iterable

from .. import _gaitfit
from .._progress import Progress, listener
from .._results import Results
from .._stages import PathLike, Settings, _list, _results, _run
from ._cluster import Cluster, Place
from ._orders import Order, Orders, silent, sources


def train(
    config: PathLike | None = None,
    *,
    robot: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: bool = False,
    progress: bool | Progress = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
    every: float = 20.0,
) -> Results:
    """Trains a policy by PPO as :func:`gaitfit.train`, each of the ``seeds`` on a worker of a Ray cluster.

    Each seed takes ``num_cpus`` CPUs, and as many threads, or a GPU with ``num_gpus``. Workers send their checkpoints every
    so many seconds (``every``); they are kept in the run folder, from which a lost worker's seed goes on on another node, and
    ``resume=True`` after the driver was killed. Other arguments as of :func:`gaitfit.ray.fit`.
    """
    cluster = Cluster(address, Place(num_cpus, num_gpus, retries))
    listen = listener(progress) or silent
    config, robot = _seen(config), _seen(robot)
    given = dict(settings or {})
    # Workers have an image of this folder, in which only relative paths are the same.
    if runs is not None or "runs" in given:
        given["runs"] = _seen(given["runs"] if runs is None else runs)
    run = _run(config, given, name, resume, None, "cpu")
    name, folder, seeds, files = _gaitfit.train_plan(run, robot, _list(seeds))
    folder, files = os.fspath(folder), [os.fspath(file) for file in files]
    theirs = _run(config, given, name, True, cluster.place.threads, cluster.place.device)
    orders = [
        Order(
            f"{name}, seed {seed}",
            f"{folder}/seed-{seed}",
            [],
            {"what": "training", "run": theirs, "robot": robot, "seeds": [seed]},
        )
        for seed in seeds
    ]
    Orders(cluster, sources(files), retries, every, listen).make(orders)
    return _results(_gaitfit.train({**run, "name": name, "resume": True}, robot, seeds, listen))


def _seen(path: PathLike | None) -> str | None:
    """A path as seen from the current folder."""
    return None if path is None else os.path.relpath(os.fspath(path))
