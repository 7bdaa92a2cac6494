"""The stages of the method."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from . import _gaitfit
from ._arguments import count, flag, items, mapping, maybe, path, real, text, threads as _threads
from ._policy import Policy
from ._progress import Progress, listener
from .results import Collection, Evaluation, FitResult, LoopResult, Training, ValidationResult
from .results import _read
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
) -> FitResult:
    """Fits the simulator's parameters to logs of a robot, as ``gaitfit fit``.

    ``config`` is a TOML file (``gaitfit config`` prints one with all defaults); the arguments win over it. ``settings``
    has any other setting by its name in the file, for example ``{"optimizer.generations": 50}``. With a ``policy`` (a
    file, or a :class:`Policy` of your own) the logs are of a robot that walks by it, without one of a clamped robot. ``progress`` is ``True``, ``False``, or a
    function of ``(kind, text, done, total)``. Ctrl-C keeps what is done; ``resume=True`` goes on with it, to the same
    bits.

    Raises :class:`GaitfitError` with the program's own message.
    """
    settings = _fit_settings(logs, robot, _named(policy), costs, settings, runs)
    run = _run(config, settings, name, resume, threads, device)
    return _read.fit_result(json.loads(_gaitfit.adapt(run, _own(policy), listener(progress), None)))


def validate(
    theta: PathLike,
    logs: PathLike | Sequence[PathLike],
    *,
    config: PathLike | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    policy: Policy | None = None,
) -> ValidationResult:
    """How well the fit in the ``theta.toml`` predicts other logs, as ``gaitfit validate``. A fit with a :class:`Policy` of
    your own needs it here too."""
    sets, files = _sets(settings or {}), (path("theta", theta), _paths("logs", logs), maybe(path, "config", config))
    if not isinstance(policy, Policy | None):
        raise TypeError(f"policy is {policy!r}; it must be a gaitfit.Policy: a policy's file is in the fit's configuration")
    return _read.validation_result(json.loads(_gaitfit.validate(*files, sets, _threads(threads), _own(policy))))


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
) -> Training:
    """Trains a policy by PPO, as ``gaitfit train``. Arguments as of :func:`fit`."""
    run = _run(config, {"runs": maybe(path, "runs", runs), **_given(settings)}, name, resume, threads, device)
    return _read.training_result(json.loads(_gaitfit.train(run, maybe(path, "robot", robot), _list(seeds), listener(progress))))


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
) -> Training:
    """Goes on training ``policy`` in the simulator that ``theta`` (a ``theta.toml``) makes, as ``gaitfit finetune``."""
    run = _run(config, {"runs": maybe(path, "runs", runs), **_given(settings)}, name, resume, threads, device)
    world = _world(_file(policy), robot, lenient, task, theta, spring, torque_noise)
    return _read.training_result(json.loads(_gaitfit.finetune(run, world, _list(seeds), listener(progress))))


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
) -> LoopResult:
    """Collects, adapts, fine-tunes and evaluates while it helps, as ``gaitfit loop``."""
    run = _run(config, {"runs": maybe(path, "runs", runs), **_given(settings)}, name, resume, threads, device)
    return _read.loop_result(json.loads(_gaitfit.run_loop(run, listener(progress))))


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
) -> Evaluation:
    """How well ``policy`` (a file, or a :class:`Policy` of your own) walks in a simulator, as ``gaitfit evaluate``: errors
    in m/s and rad/s, falls as a share."""
    world = _world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories, drift, seconds = count("trajectories", trajectories, 1), count("drift", drift, 0), real("seconds", seconds)
    terrain, device = text("terrain", terrain), text("device", device)
    return _read.evaluation_result(json.loads(_gaitfit.evaluate(world, trajectories, seconds, drift, terrain, device, listener(progress))))


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
    device: str = "cpu",
    threads: int | None = None,
    progress: bool | Progress = True,
) -> Collection:
    """Writes logs of ``policy`` (a file, or a :class:`Policy` of your own) in a simulator into the folder ``out``, as ``gaitfit collect``.
    ``device="cuda"`` simulates on a GPU."""
    world = _world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories, seconds, out = count("trajectories", trajectories, 1), real("seconds", seconds), path("out", out)
    privileged, commands = flag("privileged", privileged), maybe(path, "commands", commands)
    try:
        low, high = (float(one) for one in log_shift)
    except (TypeError, ValueError):
        raise TypeError(f"log_shift is {log_shift!r}; give two numbers, the shortest and the longest, s") from None
    simulator, files, falls = _gaitfit.collect(
        world, out, trajectories, seconds, [low, high], privileged, commands, text("device", device), listener(progress)
    )
    files = [str(file) for file in files]
    return _read.collection_result(
        {"simulator": simulator, "trajectories": len(files), "seconds": seconds, "falls": falls, "files": files}
    )


def _fit_settings(
    logs: PathLike | Sequence[PathLike] | None,
    robot: PathLike | None,
    policy: PathLike | None,
    costs: str | Sequence[str] | None,
    settings: Settings | None,
    runs: PathLike | None,
) -> dict[str, Any]:
    given = {
        "logs": maybe(_paths, "logs", logs),
        "robot": maybe(path, "robot", robot),
        "policy": policy,
        "base": None if policy is None else "free",
        "costs": [costs] if isinstance(costs, str) else maybe(_names, "costs", costs),
        "runs": maybe(path, "runs", runs),
    }
    return {**given, **_given(settings)}


def _run(
    config: PathLike | None,
    settings: Settings,
    name: str | None,
    resume: bool,
    threads: int | None,
    device: str,
) -> dict[str, Any]:
    return {
        "config": maybe(path, "config", config),
        "sets": _sets(settings),
        "name": maybe(text, "name", name),
        "resume": flag("resume", resume),
        "threads": _threads(threads),
        "device": text("device", device),
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
        "policy": _own(policy) or path("policy", _named(policy)),
        "robot": maybe(path, "robot", robot),
        "lenient": flag("lenient", lenient),
        "task": maybe(text, "task", task),
        "theta": maybe(path, "theta", theta),
        "spring": [spring] if isinstance(spring, str) else _names("spring", spring),
        "torque_noise": real("torque_noise", torque_noise),
        "randomised": flag("randomised", randomised),
        "preset": text("preset", preset),
        "seed": count("seed", seed, 0),
        "threads": _threads(threads),
    }


def _own(policy: PathLike | Policy | None) -> dict[str, Any] | None:
    return policy.native() if isinstance(policy, Policy) else None


def _file(policy: PathLike | Policy) -> PathLike:
    """The policy that is to be trained on, which must be a file."""
    if isinstance(policy, Policy) or callable(policy):
        name = policy.name if isinstance(policy, Policy) else getattr(policy, "__name__", type(policy).__name__)
        raise TypeError(
            f"the policy {name} is a function, and a function has no weights that could be trained here: give the policy's "
            "file (.safetensors, .onnx or a .toml), or train it where its weights are, with a learner of your own on "
            "gaitfit.gym.GaitfitVecEnv or gaitfit.rsl_rl.RslRlVecEnv"
        )
    return path("policy", policy)


def _named(policy: PathLike | Policy | None) -> PathLike | None:
    """The policy as a run's settings keep it: of a function its name and a hash of its interface."""
    if policy is not None and not isinstance(policy, Policy):
        if callable(policy):
            raise TypeError(
                f"policy is {policy!r}; a function needs what it sees and does: give gaitfit.Policy(function, interface)"
            )
        return path("policy", policy, ", or a gaitfit.Policy")
    if policy is None:
        return None
    digest = hashlib.sha256(f"{policy.interface.to_json()}{policy.task}".encode()).hexdigest()
    return f"the function {policy.name}, interface {digest[:12]}"


def _paths(name: str, paths: PathLike | Sequence[PathLike]) -> list[str]:
    several = [paths] if isinstance(paths, (str, os.PathLike)) else items(name, paths, "paths")
    return [path(f"an element of {name}", one) for one in several]


def _names(name: str, values: Sequence[str]) -> list[str]:
    return [text(f"an element of {name}", one) for one in items(name, values, "texts")]


def _list(seeds: Iterable[int] | None) -> list[int] | None:
    return None if seeds is None else [count("a seed", seed, 0) for seed in items("seeds", seeds, "whole numbers")]


def _given(settings: Settings | None) -> dict[str, Any]:
    return {} if settings is None else mapping("settings", settings, '{"optimizer.generations": 50}')


def _sets(settings: Settings) -> list[str]:
    """Settings as the program's ``--set`` has them: ``key=value``, the value as TOML writes it."""
    return [f"{key}={toml(value)}" for key, value in _given(settings).items() if value is not None]
