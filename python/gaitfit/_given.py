"""What users give stages, as the native half takes it."""

from __future__ import annotations

import difflib
import hashlib
import os
import re
import tempfile
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from . import _gaitfit
from ._arguments import count, existing, flag, items, mapping, maybe, path, real, text, time_limit, unicode
from ._arguments import threads as checked_threads
from ._log_files import kept
from ._logs import Log
from ._policy import Policy
from ._toml import toml
from ._settings import KEYS
from ._settings import Settings as TypedSettings
from .config import Finetune, TrueNumber, TrueParameter
from .results import FitResult

PathLike = str | os.PathLike[str]
#: Settings by their names in a file, with dots between tables.
Settings = Mapping[str, Any]
#: What a robot is beside its file.
Theta = PathLike | FitResult | TrueParameter | TrueNumber | Sequence[TrueParameter | TrueNumber]
#: What computes. ``"cuda:0,1"`` are several GPUs; other numbers of GPUs are right, too, where these are not enough.
Device = Literal[
    "cpu", "auto", "cuda", "cuda:0", "cuda:1", "cuda:2", "cuda:3", "cuda:4", "cuda:5", "cuda:6", "cuda:7",
    "cuda:0,1", "cuda:0,1,2,3", "cuda:0,1,2,3,4,5,6,7",
]
#: Where robots are stepped: the processor or one GPU. GPUs with numbers above 7 work as well.
RobotsDevice = Literal[
    "cpu", "auto", "cuda", "cuda:0", "cuda:1", "cuda:2", "cuda:3", "cuda:4", "cuda:5", "cuda:6", "cuda:7"
]
Preset = Literal["fast", "accurate", "converged"]
#: Whether to continue an earlier run: ``"auto"`` does if there is one.
Resume = bool | Literal["auto"]


def _resumed(resume: Resume) -> Resume:
    """Whether to continue, checked."""
    if resume == "auto" or isinstance(resume, bool):
        return resume
    raise TypeError(f"resume is {resume!r}; it must be True, False or \"auto\"")


def run(
    config: PathLike | TypedSettings | None,
    kind: type[TypedSettings],
    settings: Settings,
    name: str | None,
    resume: Resume,
    threads: int | None,
    device: str,
    max_seconds: float | None = None,
) -> dict[str, Any]:
    """What every stage with a run folder takes. ``kind`` is the class of typed settings that it takes."""
    file, given = configured(config, kind, settings)
    checked = {
        "sets": sets(given),
        "name": maybe(text, "name", name),
        "resume": _resumed(resume),
        "threads": checked_threads(threads),
        "device": text("device", device),
        "max_seconds": time_limit(max_seconds),
    }
    return {"config": existing("config", file), **checked}


def configured(
    config: PathLike | TypedSettings | None, kind: type[TypedSettings], settings: Settings | None
) -> tuple[str | None, dict[str, Any]]:
    """The configuration's file if it is one, and the settings that go over it."""
    if isinstance(config, TypedSettings):
        if not isinstance(config, kind):
            raise TypeError(f"config is a gaitfit.config.{type(config).__name__}; give a gaitfit.config.{kind.__name__}")
        chosen = {name: value for name, value in config.to_dict().items() if value != {}}
        return None, {**chosen, **given_settings(settings)}
    file = None if config is None else path("config", config, f", or a gaitfit.config.{kind.__name__}")
    return file, given_settings(settings)


#: Name of the built-in robot.
BUILT_IN = "unitree-go2"


def robot_of(robot: PathLike | None) -> str | None:
    """The path of a robot's file, after a check that it exists, or the name of the built-in robot."""
    found: str | None = maybe(path, "robot", robot)
    if found is None or found == BUILT_IN or os.path.exists(found):
        return found
    other = "" if Path(found).suffix else f"; the built-in robot is {BUILT_IN!r}"
    raise FileNotFoundError(f"robot: there is no file {found}{other}")


def given_settings(settings: Settings | None) -> dict[str, Any]:
    """Settings by name."""
    given = {} if settings is None else mapping("settings", settings, '{"optimizer.generations": 50}')
    for name, value in given.items():
        if isinstance(value, Mapping) and not value:
            raise ValueError(f"settings has an empty dict for {name}, which changes nothing; name the settings in it, or leave it out")
    named = {in_file(name): value for name, value in given.items()}
    if isinstance(named.get("costs"), str):
        # One cost is a list of one, as in gaitfit.fit.
        named["costs"] = costs_of(named["costs"])
    return named


def in_file(name: str) -> str:
    """A setting's name as files have it: ``parameters`` of :class:`gaitfit.config.Fit` is ``parameter`` there."""
    return ".".join(KEYS.get(part, part) for part in name.split("."))


def sets(settings: Settings | None) -> list[str]:
    """Settings as the native half takes them: ``key=value``, the value as TOML writes it."""
    try:
        return [f"{name}={toml(_plain(value))}" for name, value in given_settings(settings).items() if value is not None]
    except RecursionError:
        raise ValueError("settings has a list or a dict that contains itself, or hundreds within each other") from None


def _plain(value: Any) -> Any:
    """A setting's value: parts of :mod:`gaitfit.config` are tables."""
    if isinstance(value, TypedSettings):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {KEYS.get(name, name): _plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value


def fit_settings(
    logs: Any,
    robot: PathLike | None,
    policy: PathLike | None,
    costs: str | Sequence[str] | None,
    settings: Settings | None,
    runs: PathLike | None,
) -> dict[str, Any]:
    """The settings of a fit that are arguments too."""
    given = {
        "logs": None if logs is None else log_files(logs, runs),
        "robot": robot_of(robot),
        "policy": policy if policy is None or str(policy).startswith("the function ") else existing("policy", policy),
        "base": None if policy is None else "free",
        "costs": None if costs is None else costs_of(costs),
        "runs": maybe(path, "runs", runs),
    }
    return {**{name: value for name, value in given.items() if value is not None}, **given_settings(settings)}


def costs_of(costs: Any) -> list[str]:
    """Names of costs."""
    found = names("costs", [costs] if isinstance(costs, str) else costs)
    wrong = next((one for one in found if not re.fullmatch(r"wass|matcho|matchr[0-9]+|matchs[0-9]*", one)), None)
    if wrong is not None:
        near = difflib.get_close_matches(wrong, ["wass", "matcho", "matchr1", "matchs"], 1)
        meant = f"; did you mean {near[0]!r}? " if near else "; "
        raise ValueError(f"costs has {wrong!r}{meant}Costs are wass, matcho, and matchr and matchs with a number of samples")
    return found


def log_files(logs: Any, runs: PathLike | None) -> list[str]:
    """Logs as files. Logs and tables are written into ``runs``, where the same log has the same name."""
    several = [logs] if isinstance(logs, (str, os.PathLike, Log)) or _is_table(logs) else items("logs", logs, "paths or logs")
    folder = Path("runs" if runs is None else path("runs", runs)) / "python-logs"
    files = []
    for one in several:
        log = Log.from_dataframe(one) if _is_table(one) else one
        otherwise = ", a gaitfit.Log or a DataFrame"
        file = str(kept(log, folder)) if isinstance(log, Log) else there(path("an element of logs", log, otherwise))
        if file in files:
            raise ValueError(f"logs has the same log twice, {file}: it would count once; give each log once")
        files.append(file)
    return files


def there(file: str) -> str:
    """A log's file or folder, or a pattern of some; what is no pattern must be there."""
    return file if any(mark in file for mark in "*?[") else str(existing("logs", unicode("an element of logs", file)))


def _is_table(value: object) -> bool:
    """Whether it is a table of pandas or polars."""
    return hasattr(value, "columns") and hasattr(value, "__getitem__") and not isinstance(value, Log)


def world(
    policy: PathLike | Policy,
    robot: PathLike | None,
    lenient: bool,
    task: str | None,
    theta: Any,
    spring: Sequence[str],
    torque_noise: float,
    randomised: bool = False,
    preset: str = "fast",
    seed: int = 0,
    threads: int | None = None,
    max_seconds: float | None = None,
) -> dict[str, Any]:
    """A policy and the simulator that it walks in."""
    return {
        "policy": own(policy) or existing("policy", named_policy(policy)),
        "robot": robot_of(robot),
        "lenient": flag("lenient", lenient),
        "task": maybe(text, "task", task),
        "theta": theta_file(theta),
        "spring": [spring] if isinstance(spring, str) else names("spring", spring),
        "torque_noise": real("torque_noise", torque_noise),
        "randomised": flag("randomised", randomised),
        "preset": text("preset", preset),
        "seed": count("seed", seed, 0),
        "threads": checked_threads(threads),
        "max_seconds": time_limit(max_seconds),
    }


def chosen(config: TypedSettings | None, kind: type[TypedSettings], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments that are settings too: those that were given win over the configuration's."""
    if config is not None and not isinstance(config, kind):
        raise TypeError(f"config is {config!r}; give a gaitfit.config.{kind.__name__}")
    return {name: getattr(config, name, None) if value is None else value for name, value in arguments.items()}


def theta_file(theta: Any) -> str | None:
    """A file of a robot's values: values of a list are written into one, where the same ones have the same name."""
    if isinstance(theta, FitResult):
        return existing("theta", theta.theta)
    if theta is None or isinstance(theta, (str, os.PathLike)):
        return existing("theta", theta)
    theta = [theta] if isinstance(theta, (TrueParameter, TrueNumber)) else theta
    needed = "a path, a gaitfit.FitResult, a gaitfit.config.TrueParameter or TrueNumber, or a list of these"
    if isinstance(theta, (bytes, Mapping)) or not isinstance(theta, Iterable):
        raise TypeError(f"theta is {theta!r}; it must be {needed}")
    lines, theta = ["format = 1\n"], list(theta)
    if not theta:
        raise ValueError("theta is empty; give values, or leave it out for the robot of the file")
    for one in theta:
        if not isinstance(one, (TrueParameter, TrueNumber)):
            raise TypeError(f"theta has {one!r}; it must be {needed}")
        if one.value is None:
            raise ValueError(f"theta has a {one.kind} without a value")
        joints = one.joints or ["*"] if isinstance(one, TrueParameter) else None
        values = {"name": one.kind, "kind": one.kind, "joints": joints, "value": float(one.value)}
        lines += ["\n[[parameter]]\n", *(f"{name} = {toml(value)}\n" for name, value in values.items() if value is not None)]
    text = "".join(lines)
    folder = _theta_folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    file = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.toml"
    file.write_text(text, encoding="utf-8")
    return str(file)


def _theta_folder() -> Path:
    """Where values that are given are written."""
    return Path(tempfile.gettempdir()) / f"gaitfit-theta-{os.getuid() if hasattr(os, 'getuid') else 0}"


@contextmanager
def theta_named(theta: Any) -> Generator[Callable[[str], str], None, None]:
    """Names values that are given by what they are, in the place of the file that has them: in texts, and in errors."""
    file = re.compile(re.escape(str(_theta_folder())) + r"/[0-9a-f]{16}\.toml")
    given = [theta] if isinstance(theta, (TrueParameter, TrueNumber)) else theta
    listed = isinstance(given, Iterable) and not isinstance(given, (str, bytes, Mapping))
    known = [one for one in given if isinstance(one, (TrueParameter, TrueNumber))] if listed else []
    words = ", ".join(map(_stated, known))

    def shown(text: str) -> str:
        return file.sub(lambda _: words, text.replace("parameters of ", "") if file.search(text) else text)

    try:
        yield shown
    except _gaitfit.GaitfitError as error:
        if error.args and isinstance(error.args[0], str) and words:
            error.args = (file.sub(lambda _: f"theta ({words})", error.args[0]), *error.args[1:])
        raise


def _stated(one: TrueParameter | TrueNumber) -> str:
    """A value in a few words."""
    joints = f" at {', '.join(one.joints)}" if isinstance(one, TrueParameter) and one.joints else ""
    return f"{one.kind} {one.value:g}{joints}"


def policy_of(config: Any, others: Settings) -> str:
    """The policy that the configuration of a fine-tuning names."""
    found = others.get("policy")
    if found is None and isinstance(config, Finetune):
        found = config.policy
    elif found is None and config is not None:
        found = Finetune.read(config).policy
    if found is None:
        raise TypeError("the policy is missing: give finetune(policy, ...), or a configuration that names it")
    return path("policy", found)


def own(policy: PathLike | Policy | None) -> dict[str, Any] | None:
    """A policy that is a function, as the native half takes it."""
    return policy.native() if isinstance(policy, Policy) else None


def file_of(policy: PathLike | Policy) -> str:
    """The policy that is to be trained further, which must be a file."""
    if isinstance(policy, Policy) or (callable(policy) and not isinstance(policy, os.PathLike)):
        name = policy.name if isinstance(policy, Policy) else getattr(policy, "__name__", type(policy).__name__)
        raise TypeError(
            f"the policy {name} is a function, and a function has no weights that could be trained here: give the policy's "
            "file (.safetensors, .onnx or a .toml), or train it where its weights are, with a learner of your own on "
            "gaitfit.gym.GaitfitVecEnv or gaitfit.rsl_rl.RslRlVecEnv"
        )
    return path("policy", policy)


def named_policy(policy: PathLike | Policy | None) -> PathLike | None:
    """The policy as a run's settings keep it: of a function its name and a hash of its interface."""
    if policy is None:
        return None
    if not isinstance(policy, Policy):
        if callable(policy) and not isinstance(policy, os.PathLike):
            raise TypeError(
                f"policy is {policy!r}; a function needs what it sees and does: give gaitfit.Policy(function, interface)"
            )
        return path("policy", policy, ", or a gaitfit.Policy")
    digest = hashlib.sha256(f"{policy.described.to_json()}{policy.task}".encode()).hexdigest()
    return f"the function {policy.name}, interface {digest[:12]}"


def names(name: str, values: Sequence[str]) -> list[str]:
    """A list of texts."""
    return [text(f"an element of {name}", one) for one in items(name, values, "texts")]


def seeds_of(seeds: Iterable[int] | None) -> list[int] | None:
    """A list of seeds."""
    return None if seeds is None else [count("a seed", seed, 0) for seed in items("seeds", seeds, "whole numbers")]
