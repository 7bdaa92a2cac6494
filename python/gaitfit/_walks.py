"""Trainings, evaluations and collections: a policy in a simulator."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from . import _gaitfit
from . import _given as given
from ._arguments import count, flag, maybe, path, real, text
from ._given import Device, PathLike, Preset, Resume, Settings, Theta
from ._policy import Policy
from ._progress import Progresses, listener

if TYPE_CHECKING:
    from .config import Finetune, Train
    from .results import Collection, Evaluation, Training


def train(
    config: PathLike | Train | None = None,
    *,
    robot: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Training:
    """Trains a policy by PPO, as ``gaitfit train``.

    Arguments:
        config: A TOML file (``gaitfit init ROBOT`` writes one), or a :class:`gaitfit.config.Train`; without one the built-in
            Go2 at its task.
        robot: The robot's file, MJCF or URDF.
        seeds: One training each, one after the other.
        settings, runs, threads, progress: As for :func:`fit`.
        resume: ``True`` continues the latest run of that name, to the same bits; ``"auto"`` does if there is one. With a larger
            ``train.iterations`` the training continues, also if the run had ended. All other settings must be those that the run
            began with; other values are refused.
        name: Name of the run folder; by default that of the configuration or of its file, else that of the task.
        device: What computes; ``"cuda"`` trains on a GPU.

    Returns the result; its first policy's file is :attr:`Training.policy`.

    Raises as :func:`fit`. A training that was stopped has written the policy so far of each seed:
    ``stopped.run_folder / "seed-1" / "policy.safetensors"``.

    >>> size = {"train.environments": 64, "train.iterations": 2}
    >>> trained = gaitfit.train(settings=size, progress=False)      # doctest: +SKIP
    >>> trained.seeds[0].reward      # doctest: +SKIP
    0.02
    """
    from .config import Train
    from .results import _read

    others = {"runs": maybe(path, "runs", runs), **given.given_settings(settings)}
    run = given.run(config, Train, others, name, resume, threads, device)
    found = _gaitfit.train(run, given.robot_of(robot), given.seeds_of(seeds), listener(progress))
    return _read.training_result(json.loads(found))


def finetune(
    policy: PathLike | None = None,
    *,
    theta: Theta | None = None,
    robot: PathLike | None = None,
    task: str | None = None,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    lenient: bool = False,
    config: PathLike | Finetune | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Training:
    """Trains a policy further in a fitted simulator, as ``gaitfit finetune``.

    Arguments:
        policy: The policy's file: ``.safetensors``, ``.onnx`` or a ``.toml``. Without one ``config`` names it.
        theta: What the robot is: the fit's result or its ``theta.toml`` (:attr:`FitResult.theta`), or values of your own, a list of
            :class:`gaitfit.config.TrueParameter` and :class:`gaitfit.config.TrueNumber`. A value replaces that of the robot's
            file: ``TrueParameter("frictionloss", joints=["*_calf*"], value=0.3)`` is all of these joints' dry friction, 0.3 N·m.
            Quantities without unit whose start is 1 are factors. By default the robot of the file.
        robot: The robot's file, MJCF or URDF; by default that of the policy.
        task: Another task: a built-in one, or a file.
        spring: Springs on joints, ``"JOINT=STIFFNESS"`` or ``"JOINT=STIFFNESS@REST"``, N·m/rad and rad.
        torque_noise: Standard deviation of random torques at every joint and physics step, N·m.
        lenient: Leave out what the engine cannot simulate in the robot's file.
        config: A TOML file (``gaitfit config finetune`` prints one), or a :class:`gaitfit.config.Finetune`. The other arguments
            win over it.
        seeds, settings, name, runs, resume, device, threads, progress: As for :func:`train`.

    Returns the result; its first policy's file is ``Training.policy``.

    Raises as :func:`train`, and ``TypeError`` for a policy that is a function: it has no weights to train.

    >>> trained = gaitfit.finetune("assets/go2-walk.safetensors", theta=result.theta)      # doctest: +SKIP
    """
    from .config import Finetune
    from .results import _read

    others = {"runs": maybe(path, "runs", runs), **given.given_settings(settings)}
    run = given.run(config, Finetune, others, name, resume, threads, device)
    if policy is None:
        policy = given.policy_of(config, others)
    world = given.world(given.file_of(policy), robot, lenient, task, theta, spring, torque_noise)
    return _read.training_result(json.loads(_gaitfit.finetune(run, world, given.seeds_of(seeds), listener(progress))))


def evaluate(
    policy: PathLike | Policy,
    *,
    robot: PathLike | None = None,
    theta: Theta | None = None,
    task: str | None = None,
    trajectories: int = 10_000,
    seconds: float = 4.0,
    drift: int = 64,
    terrain: str = "own",
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: Preset = "fast",
    lenient: bool = False,
    seed: int = 0,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Evaluation:
    """How well a policy walks in a simulator, as ``gaitfit evaluate``.

    Arguments:
        policy: A file, or a :class:`Policy` of your own.
        robot, theta, task, spring, torque_noise, lenient: As for :func:`finetune`.
        trajectories: Robots with random commands.
        seconds: Length of each trajectory, s.
        drift: Robots in each trial with a constant command; 0: no such trials.
        terrain: ``"own"``: the task's ground; ``"none"``: level ground; or a kind of uneven ground, which robots cross as well.
        randomised: Whether robots differ as in the policy's training.
        preset: Solver effort of the physics.
        seed: Of commands, starts and noise.
        device, threads, progress: As for :func:`fit`.

    Returns errors of velocity, m/s and rad/s, and the share of falls, each as a mean with half the width of its 95 % interval.
    :func:`compare` returns the difference of two evaluations; with the same ``seed``, trajectory by trajectory.

    Raises ``FileNotFoundError`` for a file that is missing, ``ValueError`` for wrong numbers, :class:`GaitfitError`,
    :class:`Stopped` if ``progress`` returned ``False``, and ``KeyboardInterrupt`` after Ctrl-C.

    >>> walked = gaitfit.evaluate("assets/go2-walk.safetensors", trajectories=4, seconds=0.2, drift=0, progress=False)
    >>> walked.trajectories, walked.fall_rate.mean
    (4, 0.0)
    """
    from .results import _read

    world = given.world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories, drift, seconds = count("trajectories", trajectories, 1), count("drift", drift, 0), real("seconds", seconds)
    terrain = text("terrain", terrain)
    found = _gaitfit.evaluate(world, trajectories, seconds, drift, terrain, text("device", device), listener(progress))
    return _read.evaluation_result(json.loads(found))


def collect(
    policy: PathLike | Policy,
    out: PathLike,
    *,
    robot: PathLike | None = None,
    theta: Theta | None = None,
    task: str | None = None,
    trajectories: int = 64,
    seconds: float = 4.0,
    log_shift: tuple[float, float] = (0.0, 0.0),
    privileged: bool = False,
    commands: PathLike | None = None,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: Preset = "fast",
    lenient: bool = False,
    seed: int = 0,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Collection:
    """Writes logs of a policy in a simulator, as ``gaitfit collect``.

    Arguments:
        policy: A file, or a :class:`Policy` of your own.
        out: The folder of the logs; it must not hold CSV files.
        log_shift: Each log begins this long after its robot has started, s: the shortest and the longest time. The time is drawn
            between the two.
        privileged: Also log the base's true state, which a real robot does not measure.
        commands: A CSV file with the commands of all walks; by default they are random.
        robot, theta, task, spring, torque_noise, lenient: As for :func:`finetune`.
        trajectories, seconds, randomised, preset, seed, device, threads, progress: As for :func:`evaluate`.

    Returns the files; :func:`read_log` reads one.

    Raises as :func:`evaluate`.

    >>> logs = gaitfit.collect("assets/go2-walk.safetensors", "logs", trajectories=2)      # doctest: +SKIP
    >>> gaitfit.read_log(logs.files[0]).duration      # doctest: +SKIP
    3.98
    """
    from .results import _read

    world = given.world(policy, robot, lenient, task, theta, spring, torque_noise, randomised, preset, seed, threads)
    trajectories, seconds, out = count("trajectories", trajectories, 1), real("seconds", seconds), path("out", out)
    privileged, moves = flag("privileged", privileged), given.existing("commands", commands)
    try:
        low, high = (float(one) for one in log_shift)
    except (TypeError, ValueError):
        raise TypeError(f"log_shift is {log_shift!r}; give two numbers, the shortest and the longest, s") from None
    simulator, written, falls = _gaitfit.collect(
        world, out, trajectories, seconds, [low, high], privileged, moves, text("device", device), listener(progress)
    )
    files = [str(file) for file in written]
    return _read.collection_result(
        {"simulator": simulator, "trajectories": len(files), "seconds": seconds, "falls": falls, "files": files}
    )
