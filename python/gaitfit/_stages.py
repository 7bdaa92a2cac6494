"""Fits, their validation, and the loop."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import _gaitfit
from . import _given as given
from ._arguments import existing, flag, maybe, path
from ._arguments import threads as checked_threads
from ._given import Device, PathLike, Resume, Settings
from ._logs import Log
from ._policy import Policy
from ._progress import Progresses, listener
from .config import Cost, Fit, Loop
from .results import Comparison, Evaluation, Explanation, FitResult, LoopResult, ValidationResult, _read

if TYPE_CHECKING:
    import pandas as pd
else:
    from ._hints import pd


def fit(
    config: PathLike | Fit | None = None,
    *,
    logs: PathLike | Log | pd.DataFrame | Sequence[PathLike | Log | pd.DataFrame] | None = None,
    robot: PathLike | None = None,
    policy: PathLike | Policy | None = None,
    costs: Cost | Sequence[Cost] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> FitResult:
    """Fits the simulator's parameters to logs of a robot, as ``gaitfit fit``.

    Arguments:
        config: A TOML file (``gaitfit config`` prints one with all defaults), or a :class:`gaitfit.config.Fit`. The other
            arguments win over it.
        logs: Logs to fit: CSV files or folders, :class:`Log`, or tables with columns as in a CSV log. Logs that are not files
            are written into ``runs/python-logs``. A table has no PD gains: ``Log.from_dataframe(table, kp=20.0, kd=0.5)`` states
            them, or ``settings={"gains.kp": 20.0, "gains.kd": 0.5}``. Of walks the first second of each log does not count
            (``simulation.skip_seconds``), and 10 s in all must count; some minutes are better.
        robot: The robot's file, MJCF or URDF. (A ``robot.toml`` describes a robot that ``gaitfit mujoco-sim`` simulates; it is
            not one.)
        policy: The policy that walked: a file, or a :class:`Policy` of your own. Without one the robot's base was held and
            its legs hung in the air.
        costs: What is minimised. Each cost has a fit; the result has the values of the first. ``"wass"`` compares distributions of
            whole walks, ``"matcho"`` a free simulation sample by sample, ``"matchr1"`` short predictions from the sensors.
        settings: Any other setting by its name in a file, for example ``{"optimizer.generations": 50}``.
        name: Name of the run folder; by default that of the configuration, without one ``"fit"``. If there is such a folder,
            the next one is ``"fit-2"``. :attr:`FitResult.run_folder` has the folder's path.
        runs: Folder of the run folders; by default ``"runs"``.
        resume: ``True`` continues the latest run of that name, to the same bits; ``"auto"`` does if there is one.
        max_seconds: Wall time of the fit, s; without it as long as it needs. Half of it is for the search, unless
            ``settings={"optimizer.max_seconds": 20.0}`` limits the search itself. What is not measured when it is over, corrections
            and intervals, is left out, and :attr:`FitResult.warnings` names it; scores and the report take some seconds more.
            The same call with ``resume=True`` continues such a fit.
        device: What simulates walks.
        threads: Threads; by default one for each core.
        progress: ``True`` prints, ``False`` does not; or a function that takes an :class:`Event`, or a list of such functions and
            ``True`` (:mod:`gaitfit.callbacks`).

    Returns the result; its files are in :attr:`FitResult.run_folder`.

    Raises ``FileNotFoundError`` for a file that is missing, :class:`GaitfitError` for logs, robots and settings that cannot be
    used, :class:`Stopped` if ``progress`` returned ``False``, and ``KeyboardInterrupt`` after Ctrl-C. Both have the
    ``run_folder`` of the run that was stopped: the same call with ``resume=True`` continues it. Such a run has no result yet; with
    ``max_seconds`` a fit has one.

    >>> result = gaitfit.fit("examples/go2-demo/adapt.toml", costs="matcho")      # doctest: +SKIP
    >>> result.parameters["delay"].value      # doctest: +SKIP
    0.00701
    """
    others = given.fit_settings(logs, robot, given.named_policy(policy), costs, settings, runs)
    run = given.run(config, Fit, others, name, resume, threads, device, max_seconds)
    return _read.fit_result(json.loads(_gaitfit.adapt(run, given.own(policy), listener(progress), None)))


def validate(
    theta: PathLike,
    logs: PathLike | Log | pd.DataFrame | Sequence[PathLike | Log | pd.DataFrame],
    *,
    config: PathLike | Fit | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    policy: Policy | None = None,
    progress: Progresses = True,
) -> ValidationResult:
    """How well a fit predicts other logs, as ``gaitfit validate``.

    Arguments:
        theta: The fit's ``theta.toml`` (:attr:`FitResult.theta`).
        logs: Logs that were not fitted, as for :func:`fit`.
        config: The fit's configuration; by default the ``config.toml`` beside ``theta``. Settings of a :class:`gaitfit.config.Fit`
            go over that file.
        settings: Changes of its settings, by name.
        threads: Threads; by default one for each core.
        policy: The :class:`Policy` of a fit with a policy of your own.
        progress: As for :func:`fit`. Its events count the simulations of all logs.

    Returns the errors of the prediction, for all logs together and one by one.

    Raises ``FileNotFoundError`` for a file that is missing, :class:`GaitfitError` for logs that cannot be used, and :class:`Stopped`
    if ``progress`` returned ``False``.

    >>> checked = gaitfit.validate(result.theta, "examples/go2-demo/validate.csv")      # doctest: +SKIP
    >>> checked.rmse_rad      # doctest: +SKIP
    0.0032
    """
    file, changes = given.configured(config, Fit, settings)
    sets = given.sets(changes)
    path("theta", theta)
    if not isinstance(policy, Policy | None):
        raise TypeError(f"policy is {policy!r}; it must be a gaitfit.Policy: a policy's file is in the fit's configuration")
    threads = checked_threads(threads)
    files = given.log_files(logs, None)
    fitted, file = existing("theta", theta), existing("config", file)
    try:
        found = _gaitfit.validate(str(fitted), files, file, sets, threads, given.own(policy), listener(progress))
    except _gaitfit.GaitfitError as missing:
        name = re.search(r"policy `(the function [^`,]*)", str(missing))
        if policy is None and name is not None:
            raise _gaitfit.GaitfitError(
                f"the robot of this fit walked by {name.group(1)}, which is not a file: give it as policy=gaitfit.Policy(...)"
            ) from None
        raise
    return _read.validation_result(json.loads(found))


def loop(
    config: PathLike | Loop,
    *,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> LoopResult:
    """Collects logs, fits, trains and evaluates while it helps, as ``gaitfit loop``.

    Arguments:
        config: A TOML file (``gaitfit config loop`` prints one with all defaults), or a :class:`gaitfit.config.Loop`.
        settings, name, runs, resume, device, threads, progress: As for :func:`fit`.
        max_seconds: Wall time of the call, s; after it the loop stops with :class:`Stopped`, and ``resume=True`` continues it.

    Returns every round and measurement; the best policy's file is ``LoopResult.policy``.

    Raises as :func:`fit`.

    >>> result = gaitfit.loop("examples/go2-ground/loop.toml")      # doctest: +SKIP
    >>> result.policy      # doctest: +SKIP
    PosixPath('runs/loop/policies/policy-1.safetensors')
    """
    others = {"runs": maybe(path, "runs", runs), **given.given_settings(settings)}
    run = given.run(config, Loop, others, name, resume, threads, device, max_seconds)
    return _read.loop_result(json.loads(_gaitfit.run_loop(run, listener(progress))))


def explain(
    logs: PathLike | Log | pd.DataFrame,
    robot: PathLike = "unitree-go2",
    *,
    policy: PathLike | None = None,
    lenient: bool = False,
    progress: Progresses = True,
) -> Explanation:
    """What a robot has and its model lacks, read from walks, as ``gaitfit explain``: play and twist of gears, friction that grows
    with load, a joint whose friction differs from its siblings', a spring or a weak motor of one joint, soft ground, late or
    tilted sensors.

    Arguments:
        logs: A log of a walk, or a folder of some; as for :func:`fit`.
        robot: The robot's file, MJCF or URDF; by default the built-in Go2.
        policy: The file of the policy that walked. With it, about 30 robots without effects are simulated under the logs' commands
            (under a minute). What they show is subtracted from play, twist, friction under load and the friction of single joints.
            Play is named only with a policy.
        lenient: Leave out what the engine cannot simulate in the robot's file.
        progress: As for :func:`fit`. It counts the logs of a folder while they are read, and then the regressions. Each regression takes
            about 0.1 s for 10 s of logs.

    Friction, damping, rotor inertia and delay are no causes here, because every model has them: :func:`fit` estimates them.

    Returns the causes, the weightiest first. None does not mean that nothing is lacking: what stands in
    ``help(gaitfit.results.Explanation)`` is all that it looks for.

    Raises ``FileNotFoundError`` for a file that is missing, and :class:`GaitfitError` for logs that cannot be explained, such as those
    of legs in the air: :func:`fit` names what these show.

    >>> [cause.text for cause in gaitfit.explain("walks", "go2.xml").causes]      # doctest: +SKIP
    ['calf joints twist between motor and link by 0.0045 ± 0.0001 rad for each N·m, or 221 N·m/rad, … (fit it: compliance)']
    """
    one = given.log_files(logs, None)
    if len(one) != 1:
        raise TypeError(f"logs has {len(one)} elements; give one log, or a folder of some")
    file = given.robot_of(path("robot", robot))
    walked = None if policy is None else str(path("policy", policy))
    found = _gaitfit.explain(str(file), one[0], walked, flag("lenient", lenient), listener(progress))
    return _read.explanation_result(json.loads(found))


def compare(policy: Evaluation, against: Evaluation) -> Comparison:
    """The difference of two evaluations, ``policy`` minus ``against``, with 95 % intervals. If both have the same ``seed``,
    ``trajectories`` and ``seconds``, the same trajectories are compared one by one. The intervals are then narrower, so fewer
    trajectories show whether another policy, or a robot with other numbers, walks better.

    Arguments:
        policy, against: What :func:`evaluate` returned, for two policies or on two robots.

    Returns the differences. Errors that are negative are smaller than those of ``against``.

    Raises ``TypeError`` for an argument that is not an evaluation.

    >>> gaitfit.compare(walked, walked).tracking_error.mean
    0.0
    """
    for name, one in (("policy", policy), ("against", against)):
        if not isinstance(one, Evaluation):
            raise TypeError(f"{name} is {one!r}; give what gaitfit.evaluate returned")
    on = policy.simulator if policy.simulator == against.simulator else f"{policy.simulator} / {against.simulator}"
    paid, less = policy.reward, against.reward
    reward = {"mean": paid.mean - less.mean, "ci95": math.hypot(paid.ci95, less.ci95)}
    return _read.comparison_result({**json.loads(_gaitfit.compare(policy.to_json(), against.to_json(), on)), "reward": reward})
