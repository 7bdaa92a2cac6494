"""Trainings of several seeds, each on a worker."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from .. import _gaitfit
from .._progress import Listener, Progresses, listener
from ..results import Training
from ..results import _read
from .._arguments import mapping
from .. import _given as given
from .._given import PathLike, Resume, Settings
from ..config import Finetune, Train
from ._cluster import Cluster, Place
from ._limit import Limit
from ._orders import Order, Orders, silent, sources


def train(
    config: PathLike | None = None,
    *,
    robot: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    progress: Progresses = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
    every: float = 20.0,
) -> Training:
    """Trains a policy by PPO as :func:`gaitfit.train`, each of the ``seeds`` on a worker of a Ray cluster.

    Arguments:
        config, robot, seeds, settings, name, runs, resume, progress: As for :func:`gaitfit.train`.
        max_seconds: As for :func:`gaitfit.train`; the time to reach the cluster counts too.
        address, num_cpus, num_gpus, retries: As for :func:`gaitfit.ray.fit`, for each seed.
        every: Time between checkpoints that a worker sends, s.

    The checkpoints are kept in the run folder: another node continues a lost worker's seed from there, and ``resume=True``
    continues after this process was killed.

    Returns and raises as :func:`gaitfit.train`.

    >>> trained = gaitfit.ray.train("train.toml", seeds=range(1, 6), num_gpus=1)      # doctest: +SKIP
    """
    limit, cluster = Limit(max_seconds), Cluster(address, Place(num_cpus, num_gpus, retries))
    config, robot = _seen(config), _seen(robot)

    def run(name: str | None, resume: Resume, threads: int | None, device: str) -> dict[str, Any]:
        return given.run(config, Train, _given(settings, runs), name, resume, threads, device)

    plan = _gaitfit.train_plan(run(name, resume, None, "cpu"), robot, given.seeds_of(seeds))
    how = {"what": "training", "robot": robot}

    def rest(run: Mapping[str, Any], seeds: Sequence[int], listen: Listener) -> str:
        return _gaitfit.train(run, robot, seeds, None, listen)

    return _parts(cluster, every, limit, progress, run, plan, how, rest)


def finetune(
    policy: PathLike,
    *,
    theta: PathLike | None = None,
    robot: PathLike | None = None,
    task: str | None = None,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    lenient: bool = False,
    config: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    progress: Progresses = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
    every: float = 20.0,
) -> Training:
    """Trains ``policy``, a file, further, as :func:`gaitfit.finetune`, each of the ``seeds`` on a worker of a Ray cluster.

    Arguments:
        policy, theta, robot, task, spring, torque_noise, lenient, config, seeds, settings, name, runs, resume, progress: As for
            :func:`gaitfit.finetune`.
        max_seconds, address, num_cpus, num_gpus, retries, every: As for :func:`gaitfit.ray.train`.

    Files that the policy's file names by itself are not sent: give a
    ``.safetensors`` or ``.onnx``.

    Returns and raises as :func:`gaitfit.finetune`.

    >>> trained = gaitfit.ray.finetune("walk.safetensors", theta="theta.toml", seeds=[1, 2])      # doctest: +SKIP
    """
    named = os.path.relpath(given.file_of(policy))
    limit, cluster = Limit(max_seconds), Cluster(address, Place(num_cpus, num_gpus, retries))
    config = _seen(config)
    world = given.world(named, _seen(robot), lenient, task, _seen(theta), spring, torque_noise)

    def run(name: str | None, resume: Resume, threads: int | None, device: str) -> dict[str, Any]:
        return given.run(config, Finetune, _given(settings, runs), name, resume, threads, device)

    plan = _gaitfit.finetune_plan(run(name, resume, None, "cpu"), world, given.seeds_of(seeds))
    how = {"what": "finetuning", "world": world}

    def rest(run: Mapping[str, Any], seeds: Sequence[int], listen: Listener) -> str:
        return _gaitfit.finetune(run, world, seeds, None, listen)

    return _parts(cluster, every, limit, progress, run, plan, how, rest)


def _parts(
    cluster: Cluster,
    every: float,
    limit: Limit,
    progress: Progresses,
    run: Callable[[str | None, Resume, int | None, str], dict[str, Any]],
    plan: tuple[str, str, list[int], list[str]],
    how: Mapping[str, Any],
    rest: Callable[[Mapping[str, Any], Sequence[int], Listener], str],
) -> Training:
    """Has each seed of a training made by a worker; what is left, the results, is done here."""
    name, folder, seeds, files = plan
    place, listen = cluster.place, listener(progress) or silent
    theirs = run(name, True, place.threads, place.device)
    orders = [
        Order(f"{name}, seed {seed}", f"{os.fspath(folder)}/seed-{seed}", [], {**how, "run": theirs, "seeds": [seed]})
        for seed in seeds
    ]
    read = sources([os.fspath(file) for file in files])
    Orders(cluster, read, every, listen, limit, folder).make(orders)
    return _read.training_result(json.loads(rest(run(name, True, None, "cpu"), seeds, listen)))


def _given(settings: Settings | None, runs: PathLike | None) -> dict[str, Any]:
    """The settings; workers have an image of this folder, in which only relative paths are the same."""
    given = {} if settings is None else mapping("settings", settings, '{"train.iterations": 50}')
    if runs is not None or "runs" in given:
        given["runs"] = _seen(given["runs"] if runs is None else runs)
    return given


def _seen(path: PathLike | None) -> str | None:
    """A path as seen from the current folder."""
    return None if path is None else os.path.relpath(os.fspath(path))
