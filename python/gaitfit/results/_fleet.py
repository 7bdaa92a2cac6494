"""The results of a fleet: robots alike, whose fits improve each other."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from .. import _gaitfit
from .._arguments import path as named
from .._decode import Named, decoded
from .._settings import table_lines
from ..config import Prior
from ._base import Interval, Result
from ._fit import FitResult, FittedParameter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .._hierarchy import Hierarchy, Mixture

Scale = Literal["relative", "absolute"]
#: Half the width of a 95 % interval of a normal distribution, in standard errors.
Z95 = 1.959963984540054


@dataclass(frozen=True)
class FleetNumber:
    """One number over all robots of the fleet.

    Attributes:
        name: Its name.
        unit: Its unit.
        scale: ``"relative"`` if its logarithm scatters normally, ``"absolute"`` if the number itself does.
        center: The middle of the robots' true values, in ``unit``.
        center_interval: Its 95 % interval.
        scatter: Standard deviation of the robots' true values, without the errors of their estimates: a ratio (0.2 is 20 %) if
            ``scale`` is ``"relative"``, else in ``unit``.
        scatter_interval: Its 95 % interval.
        another: 95 % interval for the true value of another robot, before any log of it.
        lower, upper: Bounds of the search.
        calibration: Factor on the standard errors of the fits' intervals, from robots with several fits; 1 without such.

    >>> number = fleet.numbers["delay"]
    >>> number.lower < number.center < number.upper
    True
    """

    name: str
    unit: str
    scale: Scale
    center: float
    center_interval: Interval
    scatter: float
    scatter_interval: Interval
    another: Interval
    lower: float
    upper: float
    calibration: float


@dataclass(frozen=True)
class FleetEstimate:
    """One number of one robot, from its own logs and from the fleet.

    Attributes:
        name: Its name.
        unit: Its unit.
        value: The estimate from the robot's own logs and the fleet.
        interval: Its 95 % interval.
        alone: The estimate from the robot's own logs.
        alone_error: Standard error of ``alone``: of its 95 % interval, times :attr:`FleetNumber.calibration`.
        own_share: The share of the robot's own logs in ``value``, from 0 to 1.
        away: How far ``alone`` is from the fleet's center, in standard deviations of scatter and error together. Beyond 3 the
            robot is unlike the others.

    >>> 0.0 <= fleet.robots["a"]["delay"].own_share <= 1.0
    True
    """

    name: str
    unit: str
    value: float
    interval: Interval
    alone: float
    alone_error: float
    own_share: float
    away: float


@dataclass(frozen=True, kw_only=True, repr=False)
class Fleet(Result):
    """The result of :func:`gaitfit.fleet`: what the fits of robots alike show together.

    Attributes:
        headline: The result in a sentence.
        numbers: The distribution of each number over the robots.
        robots: For each robot its numbers, from its own logs and from the others.
        left_out: Numbers that are left out, each with the reason.

    >>> sorted(fleet.robots)
    ['a', 'b', 'c', 'd', 'e']
    >>> fleet.numbers["delay"].unit
    's'
    """

    headline: str
    numbers: Named[FleetNumber]
    robots: Named[Named[FleetEstimate]]
    left_out: Named[str]

    def estimate(self, result: FitResult | Sequence[FitResult]) -> Named[FleetEstimate]:
        """The numbers of another robot, from its own fit and from the fleet.

        ``result`` is a fit of the robot's logs that did not use the fleet, or several fits, each to logs of its own. The prior
        is combined with it after the fit: the product of two normal densities, for each number by itself. Numbers that the
        fleet does not have are left out. Do not pass a robot of the fleet: its logs would count twice. Its estimates are in :attr:`robots`.

        If the fleet's intervals are calibrated (:attr:`FleetNumber.calibration`), each fit must use as many logs as the
        fleet's fits do. Then give a robot with more logs more fits, not fits with more logs.

        Raises ``ValueError`` if they have no number in common, for numbers without an interval or at a bound of 0, and for a fit whose
        settings had :attr:`prior` already: it would count twice.
        """
        results = [result] if isinstance(result, FitResult) else list(result)
        common = [name for name in self.numbers if results and all(name in one.parameters for one in results)]
        if not common:
            names = ", ".join(one.name for one in results) or "of an empty list"
            raise ValueError(f"the fit {names} and the fleet have no number in common; the fleet has {', '.join(self.numbers)}")
        found: Named[FleetEstimate] = Named()
        for name in common:
            number = self.numbers[name]
            value, error = mean_of([_own(number, one.parameters[name], one.name) for one in results])
            mixture, share = self._hierarchy(name).with_estimate(value, error)
            found[name] = _estimate(number, value, error, mixture, share, self._away(number, value, error))
        return found

    @property
    def prior(self) -> Named[Prior]:
        """What the fleet states about another robot, for ``Fit(prior=fleet.prior)`` or ``settings={"prior": fleet.prior}``.

        The search begins there and pays ``optimizer.prior_weight`` for each squared deviation, which helps where logs do not
        determine a number. :meth:`estimate` weighs logs and fleet by their errors; use one of the two."""
        found: Named[Prior] = Named()
        for name, one in self.numbers.items():
            found[name] = Prior(value=one.center, deviation=(one.another[1] - one.another[0]) / (2.0 * Z95))
        return found

    def write_theta(self, result: FitResult, path: str | os.PathLike[str]) -> Path:
        """Writes the ``theta.toml`` of a fit with the estimates of :meth:`estimate` in the place of its own values.

        Arguments:
            result: The fit, of a robot of the fleet or of another one.
            path: Where the file goes.

        A robot of the fleet keeps its estimate from :attr:`robots`. Numbers that the fleet does not have stay as they are.
        The file is for :func:`gaitfit.validate`, :func:`gaitfit.finetune`, :func:`gaitfit.evaluate` and the program.

        Raises as :meth:`estimate`, and ``FileNotFoundError`` if the fit's file is missing.
        """
        file = Path(named("path", path))
        same = next((name for name, folder in self.document["folders"].items() if str(result.run_folder) in folder), None)
        estimates = self.estimate(result) if same is None else self.robots[same]
        document = json.loads(_gaitfit.read_toml(result.theta.read_text(encoding="utf-8")))
        document.pop("checksum", None)
        for saved in document["parameter"]:
            if saved["name"] in estimates:
                one = estimates[saved["name"]]
                saved.update(value=one.value, interval=list(one.interval))
        file.write_text("".join(table_lines("", document)), encoding="utf-8")
        return file

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Writes the fleet as JSON to ``path``, which :func:`gaitfit.load` reads again; returns the path. Raises ``OSError`` where
        it cannot be written."""
        file = Path(named("path", path))
        file.write_text(self.to_json(indent=1) + "\n", encoding="utf-8")
        return file

    def rows(self) -> list[dict[str, Any]]:
        """One row a robot and number: ``robot`` and the fields of :class:`FleetEstimate`, the interval as ``interval_lower``
        and ``interval_upper``."""
        rows = []
        for robot, numbers in self.robots.items():
            for one in numbers.values():
                cells = {name: getattr(one, name) for name in ("name", "unit", "value", "alone", "alone_error", "own_share", "away")}
                rows.append({"robot": robot, **cells, "interval_lower": one.interval[0], "interval_upper": one.interval[1]})
        return rows

    def _hierarchy(self, name: str) -> Hierarchy:
        # Imported here, because most programs have no fleet, and each import makes their start slower.
        from .._hierarchy import Hierarchy

        scale = self.numbers[name].scale
        values, errors = estimates_of(scale, [one[name] for one in self.robots.values()])
        return Hierarchy.of(values, errors)

    def _away(self, number: FleetNumber, value: float, error: float) -> float:
        center = scaled(number.scale, number.center, 0.0)[0]
        return (value - center) / float(np.hypot(number.scatter, error))


def fleet_result(document: Mapping[str, Any]) -> Fleet:
    """A fleet's document as a result."""
    return decoded(Fleet, document, document=dict(document))


def standard_error(one: FittedParameter, whose: str) -> float:
    """Standard error of an estimate, in its unit. If a bound of the search cuts one side of the interval, only the
    other side is used."""
    if one.interval is None:
        raise ValueError(
            f"{one.name} of {whose} has no interval, so its weight is unknown: fit at most 50 numbers, without "
            "`optimizer.max_seconds`, or leave this number out of the fit"
        )
    lower, upper = one.interval
    room = one.upper - one.lower
    whole = [abs(end - one.value) for end in (lower, upper) if one.lower + 1e-9 * room < end < one.upper - 1e-9 * room]
    half = max(whole) if len(whole) == 1 else 0.5 * (upper - lower)
    # An interval of no width is one below what the fit can resolve.
    return max(half / Z95, 1e-6 * room)


def scaled(scale: Scale, value: float, error: float) -> tuple[float, float]:
    """An estimate with its standard error on the number's scale: of the logarithm, by its derivative."""
    return (float(np.log(value)), error / value) if scale == "relative" else (value, error)


def unscaled(number: FleetNumber, value: float) -> float:
    """A value of the scale in the number's unit, within the bounds of the search."""
    plain = float(np.exp(min(value, 700.0))) if number.scale == "relative" else value
    return min(max(plain, number.lower), number.upper)


def estimates_of(scale: Scale, estimates: list[FleetEstimate]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The robots' own estimates on the number's scale, and their standard errors."""
    pairs = np.array([scaled(scale, one.alone, one.alone_error) for one in estimates])
    return pairs[:, 0], pairs[:, 1]


def mean_of(estimates: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The mean of estimates of one number, weighed by their squared standard errors, and its standard error."""
    values, errors = np.array(estimates).T
    weights = errors**-2.0
    return float((weights * values).sum() / weights.sum()), float(weights.sum() ** -0.5)


def _own(number: FleetNumber, one: FittedParameter, whose: str) -> tuple[float, float]:
    """A fit's estimate on the number's scale, and its calibrated standard error."""
    if one.prior is not None and math.isclose(one.prior.value, number.center, rel_tol=1e-9):
        raise ValueError(f"{one.name} of the fit {whose} has the fleet's prior already, so it would count twice: fit without it")
    if number.scale == "relative" and one.value <= 0:
        raise ValueError(
            f"{one.name} of the fit {whose} is {one.value:g}, at its bound; the fleet's are positive: record more logs, or use the "
            "fleet's center"
        )
    return scaled(number.scale, one.value, number.calibration * standard_error(one, whose))


def _estimate(
    number: FleetNumber, own: float, error: float, mixture: Mixture, share: float, away: float
) -> FleetEstimate:
    lower, upper = (unscaled(number, float(mixture.quantile(part))) for part in (0.025, 0.975))
    alone = float(np.exp(own)) if number.scale == "relative" else own
    alone_error = error * alone if number.scale == "relative" else error
    value = unscaled(number, float(mixture.mean))
    return FleetEstimate(number.name, number.unit, value, (lower, upper), alone, alone_error, share, away)
