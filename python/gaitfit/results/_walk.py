"""The results of trainings, evaluations and collections."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ._base import Doubt, Estimate, Result, Triple, flat, lines


@dataclass(frozen=True)
class Gait:
    """The gait of a walk straight ahead.

    Attributes:
        alternation: Share of time with exactly one gait group on the ground.
        step_frequency: Steps a second of one foot, Hz.
        duty_factor: Share of time that a foot is on the ground.
        foot_lift: Mean height of a swing, m.
        action_rate: Root-mean-square change of an action a step, per joint.
        torque: Root-mean-square torque, N·m.
        torque_power_above_10_hz: Share of the torques' power above 10 Hz, without their mean; ``None`` if it was not measured.

    >>> 0.0 <= trained.seeds[0].gait.duty_factor <= 1.0
    True
    """

    alternation: float
    step_frequency: float
    duty_factor: float
    foot_lift: float
    action_rate: float
    torque: float
    torque_power_above_10_hz: float | None = None


@dataclass(frozen=True)
class Drift:
    """A trial under a constant command, over several robots.

    Attributes:
        name: The command in a word, for example ``"+x"``.
        command: Ahead and to the left, m/s, and turning, rad/s.
        x: Final position minus the wanted one along the start's heading, m.
        y: The same to the left, m.
        yaw: Final heading minus the wanted one, rad.
        fall_rate: Share of falls.
        diverged: Robots whose simulation diverged; they count as falls.
        path: Path of the first robot: x and y, m, and heading, rad.

    >>> [trial.name for trial in walked.drift][0]
    'stand'
    """

    name: str
    command: Triple
    x: Estimate
    y: Estimate
    yaw: Estimate
    fall_rate: Estimate
    diverged: int = 0
    path: tuple[Triple, ...] = ()


@dataclass(frozen=True)
class SeedResult:
    """One seed of a training: means over its last 20 iterations, or over all if there are fewer. :meth:`Training.history` has each
    iteration.

    Attributes:
        seed: The seed.
        iterations: Iterations.
        samples: Control steps of all robots.
        reward: Mean reward of a control step.
        episode_return: Mean summed reward of an episode; ``None`` if no episode ended.
        episode_seconds: Mean length of an episode, s.
        fall_rate: Share of episodes that ended in a fall; ``None`` if no episode ended.
        linear_velocity_error: Mean error of horizontal velocity, m/s.
        angular_velocity_error: Mean error of yaw rate, rad/s.
        gait: The policy's gait.
        samples_per_second: Control steps of all robots a second.
        wall_seconds: Wall time, s.
        policy: The policy's file.
        replay: The page that shows it.
        diverged: Episodes that ended because the simulation diverged.

    >>> [(one.seed, one.iterations) for one in trained.seeds]
    [(1, 2)]
    """

    seed: int
    iterations: int
    samples: int
    reward: float
    episode_return: float | None
    episode_seconds: float | None
    fall_rate: float | None
    linear_velocity_error: float
    angular_velocity_error: float
    gait: Gait
    samples_per_second: float
    wall_seconds: float
    policy: Path
    replay: Path
    diverged: int = 0


@dataclass(frozen=True, kw_only=True, repr=False)
class Training(Result):
    """The result of :func:`gaitfit.train` and :func:`gaitfit.finetune`.

    Attributes:
        name: Name of the run.
        robot: Name of the robot.
        task: The built-in task that it began with.
        num_envs: Robots that were stepped together.
        steps: Control steps of a rollout.
        seeds: One training a seed.
        run_folder: The folder with the run's files.
        wall_seconds: Wall time of all seeds, s.
        trained: Whether the policy's actions were trained; ``False`` if all updates trained only the critic.
        doubts: Reasons not to use it as it is.
        warnings: What to know before trusting the result.

    >>> trained.policy.name, trained.num_envs
    ('policy.safetensors', 32)
    """

    name: str
    robot: str
    task: str
    num_envs: int
    steps: int
    seeds: tuple[SeedResult, ...]
    run_folder: Path
    wall_seconds: float
    trained: bool = True
    doubts: tuple[Doubt, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def policy(self) -> Path:
        """The policy of the first seed."""
        return self.seeds[0].policy

    @property
    def environments(self) -> int:
        """The earlier name of :attr:`num_envs`."""
        return self.num_envs

    def rows(self) -> list[dict[str, Any]]:
        """One row a seed."""
        return [flat(row) for row in self.document["seeds"]]

    def history(self) -> list[dict[str, Any]]:
        """One row an iteration, of all seeds one after the other, from the run folder's ``metrics.jsonl``: ``seed``, ``iteration``,
        ``samples``, ``reward``, ``episode_return``, ``fall_rate``, ``linear_velocity_error`` and more; ``pandas.DataFrame`` takes it.

        Raises ``FileNotFoundError`` if the run folder was moved or removed.

        >>> [row["iteration"] for row in trained.history()]
        [1, 2]
        """
        return [{"seed": seed.seed, **flat(row)} for seed in self.seeds for row in lines(seed.policy.parent / "metrics.jsonl")]

    def _headline(self) -> str:
        first = self.seeds[0]
        falls = "" if first.fall_rate is None else f", {first.fall_rate:.1%} of the episodes end in a fall"
        return f"{self.name}: {first.iterations} iterations, velocity error {first.linear_velocity_error:.2f} m/s{falls}"


@dataclass(frozen=True)
class Diagnosis:
    """Another order, signs or scales of the joints, with which a policy walks. With those that its file states it does not walk.

    Attributes:
        changes: What is different from the file, in words, one text for each change.
        settings: What to set in the policy's description, one line for each setting.
        measure: How badly the policy walks as its file states, and with the changes: two numbers without a unit, 0 is best.
        measured: What ``measure`` is, in words.

    >>> walked.diagnosis is None
    True
    """

    changes: tuple[str, ...]
    settings: tuple[str, ...]
    measure: tuple[float, float]
    measured: str


@dataclass(frozen=True, kw_only=True, repr=False)
class Evaluation(Result):
    """The result of :func:`gaitfit.evaluate`.

    Attributes:
        policy: The policy, by its file or name.
        simulator: Where it walked, in a few words.
        seconds: Length of a trajectory, s.
        seed: Seed of commands, starts and noise.
        trajectories: Number of trajectories.
        reward: Summed reward of a trajectory.
        linear_velocity_error: Error of horizontal velocity, m/s.
        angular_velocity_error: Error of yaw rate, rad/s.
        fall_rate: Share of falls.
        action_rate: Root-mean-square change of an action a step, per joint.
        diverged: Trajectories whose simulation diverged; they count as falls.
        motion_error: Distance of the joints from the motion that the policy follows, rad; ``None`` if it follows none. It counts
            then, and the errors of velocity mean nothing.
        drift: Trials under constant commands.
        gait: The gait straight ahead; ``None`` if the robot falls or the task has no walk ahead.
        verdict: Whether the policy walks, in a sentence; ``None`` if that cannot be judged.
        diagnosis: The order, signs and scales of joints with which the policy walks. They are looked for (``diagnose=True``) if the
            policy does not walk and gaitfit did not train it; ``None`` if none were looked for or found.
        wall_seconds: Wall time, s.

    >>> walked.trajectories, walked.fall_rate.mean
    (4, 0.0)
    """

    policy: str
    simulator: str
    seconds: float
    seed: int
    trajectories: int
    reward: Estimate
    linear_velocity_error: Estimate
    angular_velocity_error: Estimate
    fall_rate: Estimate
    action_rate: Estimate
    diverged: int = 0
    motion_error: Estimate | None = None
    drift: tuple[Drift, ...] = ()
    gait: Gait | None = None
    verdict: str | None = None
    diagnosis: Diagnosis | None = None
    wall_seconds: float = math.nan

    def rows(self) -> list[dict[str, Any]]:
        """One row a measured number: ``quantity``, ``mean``, ``ci95`` and ``unit``."""
        units = {
            "linear_velocity_error": "m/s",
            "angular_velocity_error": "rad/s",
            "fall_rate": "-",
            "reward": "-",
            "action_rate": "-",
            "motion_error": "rad",
        }
        velocities = [
            ("linear_velocity_error", self.linear_velocity_error),
            ("angular_velocity_error", self.angular_velocity_error),
        ]
        values: list[tuple[str, Estimate]] = [
            *(velocities if self.motion_error is None else [("motion_error", self.motion_error)]),
            ("fall_rate", self.fall_rate),
            ("reward", self.reward),
            ("action_rate", self.action_rate),
        ]
        return [{"quantity": name, "mean": one.mean, "ci95": one.ci95, "unit": units[name]} for name, one in values]

    def _headline(self) -> str:
        if self.motion_error is not None:
            walked = f"{self.motion_error.mean:.3f} rad off its motion"
        else:
            walked = f"velocity error {self.linear_velocity_error.mean:.3f} m/s, "
            walked += f"yaw-rate error {self.angular_velocity_error.mean:.3f} rad/s"
        errors = f"{self.policy} on {self.simulator}: {walked}, {self.fall_rate.mean:.1%} fall"
        errors = errors if self.verdict is None else f"{errors}. {self.verdict}"
        if self.diagnosis is None:
            return errors
        return f"{errors.removesuffix('.')}. It walks with {' and '.join(self.diagnosis.changes)}: set {'; '.join(self.diagnosis.settings)}"


@dataclass(frozen=True, kw_only=True, repr=False)
class Collection(Result):
    """The result of :func:`gaitfit.collect`.

    Attributes:
        simulator: Where the policy walked, in a few words.
        trajectories: Number of trajectories.
        seconds: Length of each, s.
        falls: Number of robots that fell.
        files: The logs.

    >>> collected.falls, [file.name for file in collected.files]
    (0, ['trajectory_00.csv', 'trajectory_01.csv'])
    """

    simulator: str
    trajectories: int
    seconds: float
    falls: int
    files: tuple[Path, ...]

    def rows(self) -> list[dict[str, Any]]:
        """One row a log."""
        return [{"file": str(file)} for file in self.files]

    def _headline(self) -> str:
        return f"{self.trajectories} logs of {self.seconds} s, {self.falls} falls"
