"""The results of loops and of tables of the paper."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._decode import Named
from ._base import Doubt, Estimate, Result, flat
from ._fit import FitResult
from ._walk import Evaluation, Training


@dataclass(frozen=True, kw_only=True, repr=False)
class Measurement(Evaluation):
    """An :class:`Evaluation` of a loop.

    Attributes:
        on: Where it was measured: ``"target"``, or the fitted simulator of a round.

    >>> [one.on for one in looped.evaluations]
    ['target']
    """

    on: str


@dataclass(frozen=True, kw_only=True)
class Round:
    """One round of a loop.

    Attributes:
        round: Its number, from 1.
        before: The policy that walked.
        after: The policy after its training.
        fit: The fit.
        training: The training.
        theta: The file of the parameters that the policy was trained with.
        fallback: Why the policy was trained in another simulator than the fit's; ``None`` if it was not.

    >>> [one.theta for one in looped.rounds]      # this loop has none
    []
    """

    round: int
    before: str
    after: str
    fit: FitResult
    training: Training
    theta: Path
    fallback: str | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(Result):
    """The result of :func:`gaitfit.compare`: one policy minus another, or one policy in two simulators. Errors are differences: a
    negative number means a smaller error.

    Attributes:
        policy: The policy.
        against: The policy that it is compared with.
        on: The simulator in which both walked.
        paired: Whether trajectories are compared one by one.
        trajectories: Number of trajectories that both walked.
        linear_velocity_error: Error of horizontal velocity, m/s.
        angular_velocity_error: Error of yaw rate, rad/s.
        tracking_error: Sum of both errors, m/s and rad/s.
        fall_rate: Share of falls.
        reward: Of :func:`gaitfit.compare`: the summed reward of a trajectory. Its interval is that of independent means, also where
            the trajectories are the same ones; ``None`` in a loop.

    >>> [one.tracking_error.mean for one in looped.comparisons]
    []
    """

    policy: str
    against: str
    on: str
    paired: bool
    trajectories: int
    linear_velocity_error: Estimate
    angular_velocity_error: Estimate
    tracking_error: Estimate
    fall_rate: Estimate
    reward: Estimate | None = None

    def rows(self) -> list[dict[str, Any]]:
        """One row for each difference: ``quantity``, ``mean``, ``ci95`` (half the width of the 95 % interval) and ``unit``."""
        units = {"linear_velocity_error": "m/s", "angular_velocity_error": "rad/s", "tracking_error": "m/s + rad/s", "fall_rate": "-"}
        found = {name: getattr(self, name) for name in units}
        if self.reward is not None:
            found["reward"] = self.reward
        return [
            {"quantity": name, "mean": one.mean, "ci95": one.ci95, "unit": units.get(name, "-")} for name, one in found.items()
        ]

    def _headline(self) -> str:
        linear, angular, falls = self.linear_velocity_error, self.angular_velocity_error, self.fall_rate
        how = "the same trajectories one by one" if self.paired else "trajectories that differ"
        return (
            f"{self.policy} minus {self.against} on {self.on}: velocity error {linear.mean:+.3f} ± {linear.ci95:.3f} m/s, yaw-rate error "
            f"{angular.mean:+.3f} ± {angular.ci95:.3f} rad/s, falls {100 * falls.mean:+.1f} ± {100 * falls.ci95:.1f} %; "
            f"{self.trajectories} trajectories, {how}"
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class LoopResult(Result):
    """The result of :func:`gaitfit.loop`.

    Attributes:
        name: Name of the run.
        robot: Name of the robot.
        target: The target in a few words; ``None`` without a target.
        rounds: The rounds.
        evaluations: Every policy in every simulator where it was measured, under the same commands.
        comparisons: The best policy compared with the others.
        before: Name of the policy with which the loop began.
        after: Name of the best policy.
        policy: That policy's file.
        onnx: The same policy as ONNX.
        stopped_because: Why there was no further round.
        doubts: Reasons not to use it as it is, the worst first.
        warnings: What to know before trusting the numbers.
        run_folder: The folder with the run's files.
        wall_seconds: Wall time of all stages, s.
        stage_seconds: Wall time of each stage, s.
        bought: How much better the policy is than policies that were trained without logs, in a sentence; ``None`` without such
            policies.
        next: What to do next, if the loop cannot do it.

    >>> looped.measured("before", "target").fall_rate.mean
    0.0
    """

    name: str
    robot: str
    target: str | None
    rounds: tuple[Round, ...]
    evaluations: tuple[Measurement, ...]
    comparisons: tuple[Comparison, ...]
    before: str
    after: str
    policy: Path
    onnx: Path
    stopped_because: str
    doubts: tuple[Doubt, ...]
    warnings: tuple[str, ...]
    run_folder: Path
    wall_seconds: float
    stage_seconds: Named[float]
    bought: str | None = None
    next: str | None = None

    def measured(self, policy: str, on: str) -> Measurement:
        """The measurement of the policy with the name ``policy`` in the simulator ``on``. Raises ``KeyError`` if there is none."""
        for one in self.evaluations:
            if (one.policy, one.on) == (policy, on):
                return one
        have = ", ".join(f"{one.policy} on {one.on}" for one in self.evaluations)
        raise KeyError(f"{policy} was not measured on {on}; there are {have or 'no measurements'}")

    def rows(self) -> list[dict[str, Any]]:
        """One row a measurement."""
        return [flat(row) for row in self.document["evaluations"]]


@dataclass(frozen=True)
class TableRow:
    """A cell of a table of the paper, with means over its seeds.

    Attributes:
        cell: Its name.
        scenario: What is different on the target.
        seconds: Wall time of all seeds, s.
        modification: What was fitted; ``None`` for references.
        cost: The cost; ``None`` for references.
        mean_error_percent: Mean error of the parameters, percent.
        errors_percent: Error of each parameter, percent.
        cost_value: The smallest cost.
        linear_velocity_error: Error of horizontal velocity on the target, m/s.
        angular_velocity_error: Error of yaw rate on the target, rad/s.
        fall_rate: Share of falls on the target.

    >>> table.cells[0].errors_percent["delay"].mean
    2.0
    """

    cell: str
    scenario: str
    seconds: float
    modification: str | None = None
    cost: str | None = None
    mean_error_percent: Estimate | None = None
    errors_percent: Named[Estimate] = field(default_factory=lambda: Named[Estimate]())
    cost_value: Estimate | None = None
    linear_velocity_error: Estimate | None = None
    angular_velocity_error: Estimate | None = None
    fall_rate: Estimate | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class Table(Result):
    """The result of :func:`gaitfit.ray.reproduce`.

    Attributes:
        table: Its name.
        title: What it shows.
        full: Whether it was run at the paper's scale.
        cells: The cells.
        run_folder: The folder with the run's files.

    >>> table.rows()[0]["cell"]
    'a'
    """

    table: str
    title: str
    full: bool
    cells: tuple[TableRow, ...]
    run_folder: Path

    def rows(self) -> list[dict[str, Any]]:
        """One row a cell."""
        return [flat(row) for row in self.document["rows"]]

    def _headline(self) -> str:
        return self.title
