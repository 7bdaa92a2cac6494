"""The stages of the method."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from . import _gaitfit
from ._arrays import count
from ._policy import Policy
from ._progress import Progress, listener
from ._results import Results
from ._toml import toml

PathLike = str | os.PathLike[str]
Settings = Mapping[str, Any]


def fit(
    config: PathLike | None = None,
    *,
    logs: PathLike | Sequence[PathLike] | None = None,
    robot: PathLike | None = None,
    policy: PathLike | Policy | None = None,
    costs: str | Sequence[str] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """Fits the simulator's parameters to logs of a robot, as ``gaitfit adapt``.

    ``config`` is a TOML file (``gaitfit config`` prints one with all defaults); the arguments win over it. ``settings``
    has any other setting by its name in the file, for example ``{"optimizer.generations": 50}``. With a ``policy`` (a
    file, or a :class:`Policy` of your own) the logs are of a robot that walks by it, without one of a clamped robot. ``progress`` is ``True``, ``False``, or a
    function of ``(kind, text, done, total)``. Ctrl-C keeps what is done; ``resume=True`` goes on with it, to the same
    bits.

    Raises :class:`GaitfitError` with the program's own message.
    """
    settings = _fit_settings(logs, robot, _named(policy), costs, settings, runs)
    run = _run(config, settings, name, resume, threads, device)
    return _results(_gaitfit.adapt(run, _own(policy), listener(progress), None))


def validate(
    theta: PathLike,
    logs: PathLike | Sequence[PathLike],
    *,
    config: PathLike | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    policy: Policy | None = None,
) -> Results:
    """How well the fit in the ``theta.toml`` predicts other logs, as ``gaitfit validate``. A fit with a :class:`Policy` of
    your own needs it here too."""
    sets = _sets(settings or {})
    return _results(_gaitfit.validate(_path(theta), _paths(logs), _maybe(config), sets, threads, _own(policy)))


def train(
    config: PathLike | None = None,
    *,
    robot: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """Trains a policy by PPO, as ``gaitfit train``. Arguments as of :func:`fit`."""
    run = _run(config, {"runs": runs, **dict(settings or {})}, name, resume, threads, device)
    return _results(_gaitfit.train(run, _maybe(robot), _list(seeds), listener(progress)))


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
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """Goes on training ``policy`` in the simulator that ``theta`` (a ``theta.toml``) makes, as ``gaitfit finetune``."""
    run = _run(config, {"runs": runs, **dict(settings or {})}, name, resume, threads, device)
    world = _world(_file(policy), robot, lenient, task, theta, spring, torque_noise)
    return _results(_gaitfit.finetune(run, world, _list(seeds), listener(progress)))


def loop(
    config: PathLike,
    *,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """Collects, adapts, fine-tunes and evaluates while it helps, as ``gaitfit loop``."""
    run = _run(config, {"runs": runs, **dict(settings or {})}, name, resume, threads, device)
    return _results(_gaitfit.run_loop(run, listener(progress)))


def evaluate(
    policy: PathLike | Policy,
    *,
    robot: PathLike | None = None,
    theta: PathLike | None = None,
    task: str | None = None,
    trajectories: int = 10_000,
    seconds: float = 4.0,
    drift: int = 64,
    terrain: str = "own",
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: str = "fast",
    lenient: bool = False,
    seed: int = 0,
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """How well ``policy`` (a file, or a :class:`Policy` of your own) walks in a simulator, as ``gaitfit evaluate``: errors
    in m/s and rad/s, falls as a share."""
    world = _world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories, drift = count("trajectories", trajectories, 1), count("drift", drift, 0)
    return _results(_gaitfit.evaluate(world, trajectories, seconds, drift, terrain, device, listener(progress)))


def collect(
    policy: PathLike | Policy,
    out: PathLike,
    *,
    robot: PathLike | None = None,
    theta: PathLike | None = None,
    task: str | None = None,
    trajectories: int = 64,
    seconds: float = 4.0,
    log_shift: tuple[float, float] = (0.0, 0.0),
    privileged: bool = False,
    commands: PathLike | None = None,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: str = "fast",
    lenient: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Results:
    """Writes logs of ``policy`` (a file, or a :class:`Policy` of your own) in a simulator into the folder ``out``, as ``gaitfit collect``."""
    world = _world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories = count("trajectories", trajectories, 1)
    try:
        low, high = (float(one) for one in log_shift)
    except (TypeError, ValueError):
        raise TypeError(f"log_shift is {log_shift!r}; give two numbers, the shortest and the longest, s") from None
    simulator, files, falls = _gaitfit.collect(
        world, _path(out), trajectories, seconds, [low, high], privileged, _maybe(commands), listener(progress)
    )
    files = [str(file) for file in files]
    return Results({"simulator": simulator, "trajectories": len(files), "seconds": seconds, "falls": falls, "files": files})


def _fit_settings(
    logs: PathLike | Sequence[PathLike] | None,
    robot: PathLike | None,
    policy: PathLike | None,
    costs: str | Sequence[str] | None,
    settings: Settings | None,
    runs: PathLike | None,
) -> dict[str, Any]:
    given = {
        "logs": None if logs is None else _paths(logs),
        "robot": robot,
        "policy": policy,
        "base": None if policy is None else "free",
        "costs": [costs] if isinstance(costs, str) else costs,
        "runs": runs,
    }
    return {**given, **dict(settings or {})}


def _run(
    config: PathLike | None,
    settings: Settings,
    name: str | None,
    resume: bool,
    threads: int | None,
    device: str,
) -> dict[str, Any]:
    return {
        "config": _maybe(config),
        "sets": _sets(settings),
        "name": name,
        "resume": resume,
        "threads": _threads(threads),
        "device": device,
    }


def _world(
    policy: PathLike | Policy,
    robot: PathLike | None,
    lenient: bool,
    task: str | None,
    theta: PathLike | None,
    spring: Sequence[str],
    torque_noise: float,
    randomised: bool = False,
    preset: str = "fast",
    seed: int = 0,
    threads: int | None = None,
) -> dict[str, Any]:
    return {
        "policy": _own(policy) or _path(policy),
        "robot": _maybe(robot),
        "lenient": lenient,
        "task": task,
        "theta": _maybe(theta),
        "spring": [spring] if isinstance(spring, str) else list(spring),
        "torque_noise": torque_noise,
        "randomised": randomised,
        "preset": preset,
        "seed": count("seed", seed, 0),
        "threads": _threads(threads),
    }


def _results(document: str) -> Results:
    return Results(json.loads(document))


def _path(path: PathLike) -> str:
    return os.fspath(path)


def _own(policy: PathLike | Policy | None) -> dict[str, Any] | None:
    return policy.native() if isinstance(policy, Policy) else None


def _file(policy: PathLike | Policy) -> PathLike:
    """The policy that is to be trained on, which must be a file."""
    if isinstance(policy, Policy):
        raise TypeError(f"the policy {policy.name} is a function: its networks cannot be trained on here; give a file")
    return policy


def _named(policy: PathLike | Policy | None) -> PathLike | None:
    """The policy as a run's settings keep it: of a function its name and a hash of its interface."""
    if not isinstance(policy, Policy):
        return policy
    digest = hashlib.sha256(f"{policy.interface.to_json()}{policy.task}".encode()).hexdigest()
    return f"the function {policy.name}, interface {digest[:12]}"


def _maybe(path: PathLike | None) -> str | None:
    return None if path is None else _path(path)


def _paths(paths: PathLike | Sequence[PathLike]) -> list[str]:
    return [_path(paths)] if isinstance(paths, (str, os.PathLike)) else [_path(path) for path in paths]


def _list(seeds: Iterable[int] | None) -> list[int] | None:
    if not isinstance(seeds, Iterable | None):
        raise TypeError(f"seeds is {seeds!r}; give a list of whole numbers")
    return None if seeds is None else [count("a seed", seed, 0) for seed in seeds]


def _threads(threads: int | None) -> int | None:
    return None if threads is None else count("threads", threads, 1)


def _sets(settings: Settings) -> list[str]:
    """Settings as the program's ``--set`` has them: ``key=value``, the value as TOML writes it."""
    return [f"{key}={toml(value)}" for key, value in settings.items() if value is not None]
