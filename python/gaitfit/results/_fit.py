"""The results of fits and of their validation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from .._decode import Named
from ._base import Check, Doubt, Interval, Result, flat, lines

Verdict = Literal["explained", "worse", "misfit", "worse_than_nominal", "falls", "unknown"]


@dataclass(frozen=True)
class Prior:
    """An estimate from before a fit.

    Attributes:
        value: The estimate, in the parameter's unit.
        deviation: Its standard error, in the same unit.

    >>> Prior(value=0.2, deviation=0.05).deviation
    0.05
    """

    value: float
    deviation: float


@dataclass(frozen=True)
class FittedParameter:
    """One number of the fitted simulator. All numbers are in ``unit``.

    Attributes:
        name: Its name, for example ``"frictionloss_hip"``.
        value: The estimate; corrected by simulated logs where that belongs to the fit (``uncorrected`` is the search's).
        unit: Its unit; ``"-"`` for a ratio.
        lower, upper: Bounds of the search.
        start: Where the search began.
        at_bound: Whether the estimate is at a bound: the true value may be beyond.
        interval: The 95 % interval, ``(lower, upper)``, or ``None`` if it was not measured, as after a time limit.
        identified: Whether the logs determine it: the interval is narrower than half of the search's bounds. ``None`` if that was not
            measured.
        spread: Standard deviation of the estimates of several seeds, or ``None`` with one.
        uncorrected: The estimate before simulated logs corrected it, or ``None`` without correction.
        truth: The true value, from the settings' ``truth``.
        published: Published values, ``(smallest, largest)``, from the settings' ``published``.
        prior: The estimate from before the fit.

    >>> delay = result.parameters["delay"]
    >>> delay.unit, delay.lower < delay.value < delay.upper
    ('s', True)
    """

    name: str
    value: float
    unit: str
    lower: float
    upper: float
    start: float
    at_bound: bool
    interval: Interval | None = None
    identified: bool | None = None
    spread: float | None = None
    uncorrected: float | None = None
    truth: float | None = None
    published: Interval | None = None
    prior: Prior | None = None


@dataclass(frozen=True)
class Spring:
    """A spring on a joint: torque = stiffness · (rest − angle).

    Attributes:
        joint: The joint.
        stiffness: N·m/rad.
        stiffness_interval: Its 95 % interval, N·m/rad.
        rest: Angle without torque, rad; ``None`` where the stiffness may be 0.
        rest_interval: Its 95 % interval, rad.

    >>> Spring("FL_calf_joint", stiffness=30.0, rest=-1.5).stiffness
    30.0
    """

    joint: str
    stiffness: float
    stiffness_interval: Interval | None = None
    rest: float | None = None
    rest_interval: Interval | None = None


@dataclass(frozen=True)
class Sharing:
    """What workers did for a fit, and what the driver did alone.

    Attributes:
        tasks: Tasks of each kind that workers did: ``"costs"`` (candidates of a search), ``"intervals"`` (moved values, for
            intervals), ``"signals"`` (simulations whose signals came back, for derivatives), ``"corrections"`` (sets of simulated
            logs).
        workers: Seconds of each worker's work, by node and process.
        driver_seconds: Processor time of the driver, s: for the parts of the fit that were not shared, and for handing out tasks.
        alone: What the driver computed alone.

    >>> shared = result.sharing
    >>> shared is None      # of gaitfit.fit; gaitfit.ray.fit has one
    True
    """

    tasks: Named[int]
    workers: Named[float]
    driver_seconds: float
    alone: tuple[str, ...]

    def __str__(self) -> str:
        tasks = ", ".join(f"{count} of {kind}" for kind, count in self.tasks.items()) or "none"
        return (
            f"tasks of workers: {tasks}; {len(self.workers)} workers computed {sum(self.workers.values()):.1f} s, this process "
            f"{self.driver_seconds:.1f} s alone ({', '.join(self.alone)})"
        )


@dataclass(frozen=True)
class Score:
    """How well a predictor predicts the logs.

    Attributes:
        name: The predictor.
        cost: Its cost on the fitted logs; ``None`` if its simulation diverged.
        rmse_fit_rad: Position error (RMS) of free simulation on the fitted logs, rad; ``None`` where samples cannot be
            compared.
        rmse_validation_rad: The same on the validation logs, rad.
        cost_validation: Its cost on the validation logs.
        delay_seconds: The delay of a pure delay, s.

    >>> [score.name for score in result.baselines][0]
    'nominal model'
    """

    name: str
    cost: float | None
    rmse_fit_rad: float | None
    rmse_validation_rad: float | None
    cost_validation: float | None = None
    delay_seconds: float | None = None


@dataclass(frozen=True)
class ValidatedLog:
    """The prediction of one log that was not fitted.

    Attributes:
        file: The log's file.
        cost: The cost on this log; ``None`` if the simulation diverged.
        nominal_cost: The cost of the robot before the fit.
        rmse_rad: Position error (RMS) over samples and joints, rad; ``None`` where samples cannot be compared.
        nominal_rmse_rad: The same of the robot before the fit, rad.
        rmse_per_joint: The position error of each joint, rad.
        fell: Whether the simulated robot fell.

    >>> for log in result.validation:
    ...     print(log.file, log.fell)
    examples/go2-demo/validate.csv False
    """

    file: str
    cost: float | None
    nominal_cost: float | None
    rmse_rad: float | None
    nominal_rmse_rad: float | None
    rmse_per_joint: Named[float]
    fell: bool = False


@dataclass(frozen=True)
class HeldOut:
    """Walks that were not fitted, compared with simulated walks under the same commands.

    Attributes:
        logs: Number of logs, or stretches of logs.
        seconds: Their duration, s.
        cost: ``wass`` of the fitted robot, all simulations of the walks pooled; ``None`` if one diverged.
        nominal_cost: The same of the robot before the fit.
        falls: Falls of the fitted robot in all simulations, ``simulations`` × ``logs`` walks.
        nominal_falls: Falls of the robot before the fit in as many walks.
        simulations: Number of simulations of the walks, each with other random torques. A robot without random torques
            is simulated once and counts as often.
        single_costs: ``wass`` of the fitted robot in each simulation alone.

    >>> result.held_out is None      # the demonstration's legs hang in the air
    True
    """

    logs: int
    seconds: float
    cost: float | None
    nominal_cost: float | None
    falls: int
    nominal_falls: int
    simulations: int = 1
    single_costs: tuple[float, ...] = ()


@dataclass(frozen=True)
class CostFit:
    """The fit of one cost.

    Attributes:
        cost_name: The cost.
        cost: Its value for the parameters.
        nominal_cost: Its value for the robot before the fit; ``None`` if that diverged.
        converged: Whether the search converged.
        better_than_nominal: Whether the fitted robot is closer to the logs than the robot before the fit.
        doubts: Reasons not to take the fit as it is, the worst first.
        parameters: The parameters by name.

    >>> [fit.cost_name for fit in result.fits]
    ['matcho']
    """

    cost_name: str
    cost: float
    nominal_cost: float | None
    converged: bool
    better_than_nominal: bool
    doubts: tuple[Doubt, ...]
    parameters: Named[FittedParameter]


@dataclass(frozen=True, kw_only=True, repr=False)
class FitResult(Result):
    """The result of :func:`gaitfit.fit`.

    Attributes:
        name: Name of the run.
        robot: Name of the robot.
        headline: The result in a sentence, its doubts first.
        standing: How firm it is: ``"contradicted"`` if walks that were not fitted speak against it.
        doubts: Reasons not to take it as it is, the worst first. Some of them name a regression. It predicts the values from the logs,
            has learned from simulated robots with values near those of the search, and gives the intervals.
        converged: Whether the search converged.
        better_than_nominal: Whether the fitted robot is closer to the logs than the robot before the fit.
        cost_name: The first cost.
        cost: Its value for the parameters, on the fitted logs.
        nominal_cost: Its value for the robot before the fit; ``None`` if that diverged.
        parameters: The fitted parameters by name.
        fitted: How well the fitted simulator predicts.
        baselines: How well the robot before the fit does, and predictors without a simulator.
        validation: Logs that were not fitted, one by one.
        fits: One fit for each cost; the first one's parameters are :attr:`parameters`.
        checks: Checks that the settings ask for.
        warnings: What to know before trusting the numbers.
        trajectories: Logs, or stretches of logs, that were compared.
        seconds: Their duration, s.
        run_folder: The folder with the run's files.
        wall_seconds: Wall time, s.
        springs: Springs on joints.
        verdict: Walking logs: the verdict of walks that were not fitted; ``None`` without such walks.
        held_out: Walking logs: these walks in numbers.
        falls: Walking logs in which the robot fell; they were cut there.
        sharing: Of :func:`gaitfit.ray.fit`: what workers did. It is not part of the run folder.

    >>> result = gaitfit.fit("examples/go2-demo/adapt.toml")      # doctest: +SKIP
    >>> result.parameters["delay"].value, result.parameters["delay"].unit      # doctest: +SKIP
    (0.00701, 's')
    """

    name: str
    robot: str
    headline: str
    standing: Literal["sound", "doubtful", "contradicted"]
    doubts: tuple[Doubt, ...]
    converged: bool
    better_than_nominal: bool
    cost_name: str
    cost: float
    nominal_cost: float | None
    parameters: Named[FittedParameter]
    fitted: Score
    baselines: tuple[Score, ...]
    validation: tuple[ValidatedLog, ...]
    fits: tuple[CostFit, ...]
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    trajectories: int
    seconds: float
    run_folder: Path
    wall_seconds: float
    springs: tuple[Spring, ...] = ()
    verdict: Verdict | None = None
    held_out: HeldOut | None = None
    falls: int = 0
    sharing: Sharing | None = field(default=None, compare=False)

    @property
    def theta(self) -> Path:
        """The file of the fitted parameters, for :func:`gaitfit.validate`, :func:`gaitfit.finetune` and others."""
        return self.run_folder / "theta.toml"

    def history(self) -> list[dict[str, Any]]:
        """One row a generation of the search, of all costs and seeds, from the run folder's ``metrics.jsonl``: ``cost``, ``seed``,
        ``generation``, ``best``, ``best_so_far``, ``mean``, ``sigma`` and more; ``pandas.DataFrame`` takes it.

        Raises ``FileNotFoundError`` if the run folder was moved or removed.

        >>> result.history()[0]["generation"]
        1
        """
        return [flat(row) for row in lines(self.run_folder / "metrics.jsonl")]

    def rows(self) -> list[dict[str, Any]]:
        """One row a parameter: ``name``, ``value``, ``unit``, ``interval_lower`` and ``interval_upper`` (the 95 % interval),
        ``identified``, ``spread``, ``lower`` and ``upper`` (bounds of the search), ``start``, ``at_bound``, ``uncorrected`` and
        ``truth``; ``None`` where there is no value."""
        return [_row(one) for one in self.parameters.values()]


@dataclass(frozen=True, kw_only=True, repr=False)
class ValidationResult(Result):
    """The result of :func:`gaitfit.validate`.

    Attributes:
        theta: The file of the fitted parameters.
        robot: Name of the robot.
        headline: The result in a sentence, a doubt first.
        better_than_nominal: Whether the fitted robot is closer to these logs than the robot before the fit.
        cost_name: The cost: the fit's first.
        cost: Its value on these logs; ``None`` if a simulation diverged.
        nominal_cost: The same of the robot before the fit.
        rmse_rad: Mean position error (RMS) over logs, rad; ``None`` where samples cannot be compared.
        nominal_rmse_rad: The same of the robot before the fit, rad.
        validation: The logs one by one.
        checks: Checks that the settings ask for.
        warnings: What to know before trusting the numbers.
        verdict: Walking logs: their verdict; ``None`` for a clamped robot.
        held_out: Walking logs in numbers.

    >>> checked = gaitfit.validate(result.theta, "examples/go2-demo/validate.csv")
    >>> checked.cost_name, len(checked.validation)
    ('matcho', 1)
    """

    theta: Path
    robot: str
    headline: str
    better_than_nominal: bool
    cost_name: str
    cost: float | None
    nominal_cost: float | None
    rmse_rad: float | None
    nominal_rmse_rad: float | None
    validation: tuple[ValidatedLog, ...]
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    verdict: Verdict | None = None
    held_out: HeldOut | None = None

    def rows(self) -> list[dict[str, Any]]:
        """One row a log."""
        return [flat(row) for row in self.document["validation"]]


@dataclass(frozen=True)
class Cause:
    """Something that a robot has and its model lacks.

    Attributes:
        kind: What it is, in snake case: ``"backlash"`` is play, ``"elasticity"`` twist; the others are ``"load_friction"``,
            ``"odd_friction"``, ``"odd_spring"``, ``"odd_strength"``, ``"ground"``, ``"velocity_lag"``, ``"gyro_bias"``, ``"tilt"``
            and ``"encoder_step"``.
        of: The joint group or joint that has it; empty for the whole robot.
        value: Its size, in ``unit``.
        error: The size's standard error.
        unit: Unit of the size.
        weight: The size divided by the smallest size that changes how a robot walks.
        text: The cause in a sentence, with its evidence and its remedy.

    >>> Cause("backlash", "calf", 0.014, 0.002, "rad", 3.0, "the calf joints have play").of
    'calf'
    """

    kind: str
    of: str
    value: float
    error: float
    unit: str
    weight: float
    text: str


@dataclass(frozen=True, kw_only=True, repr=False)
class Explanation(Result):
    """The result of :func:`gaitfit.explain`. It looks for play and twist of gears, friction that grows with load, a joint whose
    friction differs from its siblings', a spring or a weak motor of one joint, soft ground, and late or tilted sensors. It looks for
    play only if it gets the policy.

    Attributes:
        logs: The log or the folder.
        robot: The robot's file.
        causes: What the robot has and its model lacks, the largest weight first.
        warnings: What to know of robot, policy and logs. Empty without a policy.

    >>> explained = gaitfit.explain("walks", "go2.xml", policy="policy.onnx")      # doctest: +SKIP
    >>> explained.causes[0].kind      # doctest: +SKIP
    'backlash'
    """

    logs: str
    robot: str
    causes: tuple[Cause, ...]
    warnings: tuple[str, ...]

    def rows(self) -> list[dict[str, Any]]:
        """One row a cause."""
        return [flat(row) for row in self.document["causes"]]

    def _headline(self) -> str:
        return "; ".join(one.text for one in self.causes) or (
            "none of the effects that it looks for shows in these logs; a joint that differs from its siblings shows in a fit with "
            "odd_joints=True"
        )

    def _columns(self) -> list[str]:
        return ["kind", "of", "size.value", "size.error", "size.unit", "weight", "text"]


def _row(one: FittedParameter) -> dict[str, Any]:
    low, high = one.interval or (None, None)
    before = {"name": one.name, "value": one.value, "unit": one.unit, "interval_lower": low, "interval_upper": high}
    others = ("identified", "spread", "lower", "upper", "start", "at_bound", "uncorrected", "truth")
    return {**before, **{name: getattr(one, name) for name in others}}
