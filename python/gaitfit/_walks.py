"""Trainings, evaluations and collections: a policy in a simulator."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from . import _gaitfit
from . import _given as given
from ._arguments import count, existing, flag, items, maybe, path, real, text
from ._given import Device, PathLike, Preset, Resume, Settings, Theta
from ._policy import Policy
from ._progress import Progresses, listener
from ._terms import Terms
from ._training_terms import called
from .config import Collect, Evaluate, Finetune, Train
from .results import Collection, Evaluation, Training, _read


def train(
    config: PathLike | Train | None = None,
    *,
    robot: PathLike | None = None,
    seeds: Iterable[int] | None = None,
    settings: Settings | None = None,
    terms: Terms | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
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
        terms: A reward and ends of episodes of your own, :class:`gaitfit.Terms` without an observation. They are called with up to
            256 robots at a time, which have what :class:`gaitfit.TrainingRobots` lists, after each of their steps, and must remember
            nothing between calls; an exception ends the training and is raised unchanged. A run with terms continues with terms
            alone; that they are the same is not checked. Rewards that an expression can say need no terms:
            ``settings={"task.terms.low": "height < 0.2", "task.rewards.low": -1.0}``, also on GPUs.
        resume: ``True`` continues the latest run of that name, to the same bits; ``"auto"`` does if there is one. More
            ``train.iterations`` than the run has train on, also after its end; other settings must be those it began with, and a
            change that would train something else is refused.
        name: Name of the run folder; by default that of the configuration or of its file, else that of the task.
        max_seconds: Wall time of the call, s; after it the training stops with :class:`Stopped`, and ``resume=True`` continues it.
        device: What computes; ``"cuda"`` trains on a GPU.

    Returns the result; its first policy's file is :attr:`Training.policy`.

    Raises as :func:`fit`. A training that was stopped has written the policy so far of each seed:
    ``stopped.run_folder / "seed-1" / "policy.safetensors"``.

    >>> size = {"train.num_envs": 64, "train.iterations": 2}
    >>> trained = gaitfit.train(settings=size, progress=False)      # doctest: +SKIP
    >>> trained.seeds[0].reward      # doctest: +SKIP
    0.02

    With a reward of your own, which pays for steps without rolling:

    >>> def steady(robots, motion):
    ...     return robots.reward - 0.1 * robots.control_dt * np.abs(motion.base_angular_velocity[:, 0])
    >>> trained = gaitfit.train(settings=size, terms=gaitfit.Terms(reward=steady), progress=False)      # doctest: +SKIP
    """
    others = {"runs": maybe(path, "runs", runs), **given.given_settings(settings)}
    run = given.run(config, Train, others, name, resume, threads, device, max_seconds)
    found = _gaitfit.train(run, given.robot_of(robot), given.seeds_of(seeds), called(terms, device), listener(progress))
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
    terms: Terms | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Training:
    """Trains a policy further in a fitted simulator, as ``gaitfit finetune``.

    Arguments:
        policy: The policy's file: ``.safetensors``, ``.onnx`` or a ``.toml``. Without one ``config`` names it.
        theta: What the robot is: the fit's result or its ``theta.toml`` (:attr:`FitResult.theta`), or values of your own, one
            :class:`gaitfit.config.TrueParameter` or :class:`gaitfit.config.TrueNumber` or a list. A value replaces that of the
            robot's file (:func:`read_robot` has it): ``TrueParameter("frictionloss", joints=["*_calf*"], value=0.3)`` is all of these joints' dry friction, 0.3 N·m.
            Quantities without unit whose start is 1 are factors. By default the robot of the file.
        robot: The robot's file, MJCF or URDF; by default that of the policy.
        task: Another task: a built-in one, or a file.
        spring: Springs on joints, ``"JOINT=STIFFNESS"`` or ``"JOINT=STIFFNESS@REST"``, N·m/rad and rad.
        torque_noise: Standard deviation of random torques at every joint and physics step, N·m.
        lenient: Leave out what the engine cannot simulate in the robot's file.
        config: A TOML file (``gaitfit config finetune`` prints one), or a :class:`gaitfit.config.Finetune`. The other arguments
            win over it.
        seeds, settings, terms, name, runs, resume, max_seconds, device, threads, progress: As for :func:`train`.

    Returns the result; its first policy's file is ``Training.policy``.

    Raises as :func:`train`, and ``TypeError`` for a policy that is a function: it has no weights to train.

    >>> trained = gaitfit.finetune("assets/go2-walk.safetensors", theta=result.theta)      # doctest: +SKIP
    """
    others = {"runs": maybe(path, "runs", runs), **given.given_settings(settings)}
    run = given.run(config, Finetune, others, name, resume, threads, device, max_seconds)
    if policy is None:
        policy = given.policy_of(config, others)
    world = given.world(given.file_of(policy), robot, lenient, task, theta, spring, torque_noise)
    with given.theta_named(theta):
        found = _gaitfit.finetune(run, world, given.seeds_of(seeds), called(terms, device), listener(progress))
    return _read.training_result(json.loads(found))


def evaluate(
    policy: PathLike | Policy,
    *,
    config: Evaluate | None = None,
    robot: PathLike | None = None,
    theta: Theta | None = None,
    task: str | None = None,
    trajectories: int | None = None,
    seconds: float | None = None,
    drift: int | None = None,
    drift_speeds: tuple[float, float, float] | None = None,
    terrain: str = "own",
    diagnose: bool = True,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: Preset | None = None,
    lenient: bool = False,
    seed: int | None = None,
    max_seconds: float | None = None,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Evaluation:
    """How well a policy walks in a simulator, as ``gaitfit evaluate``.

    Arguments:
        policy: A file, or a :class:`Policy` of your own.
        robot, theta, task, spring, torque_noise, lenient: As for :func:`finetune`. A policy that was trained in a fitted simulator
            walks in the robot of its file, too, unless ``theta`` is given.
        config: A :class:`gaitfit.config.Evaluate` with ``trajectories``, ``seconds``, ``drift``, ``drift_speeds``, ``preset`` and
            ``seed``, as a loop has it. Arguments win over it.
        trajectories: Robots with random commands, one trajectory each; by default 10000.
        seconds: Length of each trajectory, s; by default 4, or the length of the motion that the policy follows.
        drift: Robots in each trial with a constant command; by default 64; 0: no such trials.
        drift_speeds: Speeds of these: ahead and to the side, m/s, and turning, rad/s; by default half of the task's greatest
            commands.
        terrain: ``"own"``: the task's ground; ``"none"``: level; or a kind of uneven ground, which is crossed as well.
        diagnose: Whether other orders, signs and scales of joints are tried if the policy does not walk and gaitfit did not train it.
            This takes some seconds, so turn it off if you evaluate often while a learner trains.
        randomised: Whether robots differ as in the policy's training.
        preset: Solver effort of the physics; by default ``"fast"``.
        seed: Of commands, starts and noise; by default 0.
        max_seconds: Wall time of the call, s; after it :class:`Stopped` is raised, and nothing is kept.
        device, threads: As for :func:`fit`.
        progress: As for :func:`fit`. Step events come at most ten times a second. They count the simulated seconds of all robots together,
            for each part by itself: random commands, constant commands (``drift``) and uneven ground. The trials of ``diagnose``
            are counted, too.

    Returns errors of velocity, m/s and rad/s, and the share of falls, each as a mean with half the width of its 95 % interval.
    :func:`compare` returns the difference of two evaluations; with the same ``seed``, trajectory by trajectory.

    Raises ``FileNotFoundError`` for a file that is missing, ``ValueError`` or :class:`GaitfitError` for arguments that cannot be used,
    :class:`Stopped` if ``progress`` returned ``False`` or ``max_seconds`` are over, and ``KeyboardInterrupt`` after Ctrl-C.

    >>> walked = gaitfit.evaluate("assets/go2-walk.safetensors", trajectories=4, seconds=0.2, drift=0, progress=False)
    >>> walked.trajectories, walked.fall_rate.mean
    (4, 0.0)
    """
    arguments = {"trajectories": trajectories, "seconds": seconds, "drift": drift, "drift_speeds": drift_speeds}
    numbers = _EVALUATE | _stated(given.chosen(config, Evaluate, {**arguments, "preset": preset, "seed": seed}))
    solver, draws = numbers["preset"], numbers["seed"]
    world = given.world(
        policy, robot, lenient, task, theta, spring, torque_noise, randomised, solver, draws, threads, max_seconds
    )
    robots, trials = count("trajectories", numbers["trajectories"], 1), count("drift", numbers["drift"], 0)
    speeds = maybe(_speeds, "drift_speeds", numbers.get("drift_speeds"))
    length, terrain = maybe(real, "seconds", numbers.get("seconds")), text("terrain", terrain)
    with given.theta_named(theta) as shown:
        found = _gaitfit.evaluate(
            world, robots, length, trials, speeds, terrain, flag("diagnose", diagnose), text("device", device), listener(progress)
        )
    document = json.loads(found)
    return _read.evaluation_result({**document, "simulator": shown(document["simulator"])})


def collect(
    policy: PathLike | Policy,
    out: PathLike,
    *,
    config: Collect | None = None,
    robot: PathLike | None = None,
    theta: Theta | None = None,
    task: str | None = None,
    trajectories: int | None = None,
    seconds: float | None = None,
    log_shift: tuple[float, float] | None = None,
    privileged: bool | None = None,
    commands: PathLike | None = None,
    spring: Sequence[str] = (),
    torque_noise: float = 0.0,
    randomised: bool = False,
    preset: Preset | None = None,
    lenient: bool = False,
    seed: int | None = None,
    max_seconds: float | None = None,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Progresses = True,
) -> Collection:
    """Writes logs of a policy in a simulator, as ``gaitfit collect``.

    Arguments:
        policy: A file, or a :class:`Policy` of your own.
        out: The folder of the logs; it must not hold CSV files.
        config: A :class:`gaitfit.config.Collect` with ``trajectories``, ``seconds``, ``log_shift``, ``privileged``, ``commands``,
            ``preset`` and ``seed``. Arguments win over it.
        trajectories: Logs, one robot each; by default 64.
        log_shift: Each log begins this long after the robot, s: shortest and longest; it is drawn between the two. By default
            0 and 0.
        privileged: Also log the base's true state, which a real robot does not measure; by default it is not logged.
        commands: A CSV file with the commands of all walks; by default they are random.
        robot, theta, task, spring, torque_noise, lenient: As for :func:`finetune`.
        seconds, randomised, preset, seed, max_seconds, device, threads: As for :func:`evaluate`.
        progress: As for :func:`fit`. Step events come at most ten times a second. They count the simulated seconds of all robots together;
            with ``commands`` they count logs.

    Returns the files; :func:`read_log` reads one.

    Raises as :func:`evaluate`.

    >>> logs = gaitfit.collect("assets/go2-walk.safetensors", "logs", trajectories=2)      # doctest: +SKIP
    >>> gaitfit.read_log(logs.files[0]).duration      # doctest: +SKIP
    3.98
    """
    arguments = {"trajectories": trajectories, "seconds": seconds, "log_shift": log_shift, "privileged": privileged}
    more = {"commands": commands, "preset": preset, "seed": seed}
    numbers = _COLLECT | _stated(given.chosen(config, Collect, {**arguments, **more}))
    solver, draws = numbers["preset"], numbers["seed"]
    world = given.world(
        policy, robot, lenient, task, theta, spring, torque_noise, randomised, solver, draws, threads, max_seconds
    )
    robots, length = count("trajectories", numbers["trajectories"], 1), real("seconds", numbers["seconds"])
    out, moves = path("out", out), existing("commands", numbers.get("commands"))
    whole, shift = flag("privileged", numbers["privileged"]), numbers["log_shift"]
    try:
        low, high = (float(one) for one in shift)
    except (TypeError, ValueError):
        raise TypeError(f"log_shift is {shift!r}; give two numbers, the shortest and the longest, s") from None
    with given.theta_named(theta) as shown:
        simulator, written, falls = _gaitfit.collect(
            world, out, robots, length, [low, high], whole, moves, text("device", device), listener(progress)
        )
    files = [str(file) for file in written]
    return _read.collection_result(
        {"simulator": shown(simulator), "trajectories": len(files), "seconds": length, "falls": falls, "files": files}
    )


#: Defaults of :func:`evaluate` and :func:`collect`; a loop has its own.
_EVALUATE: dict[str, Any] = {"trajectories": 10_000, "drift": 64, "preset": "fast", "seed": 0}
_COLLECT: dict[str, Any] = {
    "trajectories": 64, "seconds": 4.0, "log_shift": (0.0, 0.0), "privileged": False, "preset": "fast", "seed": 0
}


def _stated(numbers: dict[str, Any]) -> dict[str, Any]:
    """Those that were given."""
    return {name: value for name, value in numbers.items() if value is not None}


def _speeds(name: str, value: Any) -> list[float]:
    """Three speeds."""
    speeds = [real(f"an element of {name}", one) for one in items(name, value, "three speeds")]
    if len(speeds) != 3:
        raise ValueError(f"{name} has {len(speeds)} elements; give three: ahead and to the side, m/s, and turning, rad/s")
    return speeds
