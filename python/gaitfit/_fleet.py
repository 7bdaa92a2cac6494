"""A fleet of robots of one kind: the distribution of their numbers, which predicts those of another robot."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ._arguments import items
from ._hierarchy import MIN_ROBOTS, Array, Hierarchy
from .results._base import Interval
from .results._fit import FitResult, FittedParameter
from .results._fleet import Fleet, FleetEstimate, FleetNumber, Scale, fleet_result, mean_of, scaled, standard_error, unscaled
from .results._read import load

#: Relative standard error above which the logarithm of an estimate is not normal.
MAX_RELATIVE = 0.5
#: An estimate below this share of the median counts as near 0, so logarithms are not used.
SMALL = 0.1


#: A robot's fit, or its run folder.
Given = FitResult | str | os.PathLike[str]


def fleet(fits: Mapping[str, Given | Sequence[Given]] | Sequence[Given | Sequence[Given]]) -> Fleet:
    """Combines the fits of robots of one kind: how each number scatters over the robots.

    Arguments:
        fits: For each robot its fit, or the fit's run folder, or several fits to different logs of the robot; by the robots'
            names, or as a list. At least 4 robots, all fitted in the same way.

    Each number has its own normal hierarchical model. The model uses the logarithm if no estimate is near 0 or negative
    and the median relative standard error is below one half, else the number itself. The weight of an estimate follows
    from its 95 % interval. Robots with few logs move towards the others,
    and :meth:`Fleet.estimate` does the same for another robot.

    Intervals also cover effects that the model may lack, so they can be wider than the scatter of the estimates.
    Several fits of a robot show that scatter. :attr:`FleetNumber.calibration` is the ratio of their differences to
    those that their intervals predict. All standard errors are multiplied by it.

    Returns the numbers of the fleet and of each robot.

    Raises ``ValueError`` for fewer than 4 robots, for fits without a common number, and for numbers without an interval.

    >>> results = {name: gaitfit.fit(logs=f"logs/{name}", name=name) for name in robots}      # doctest: +SKIP
    >>> fleet = gaitfit.fleet(results)      # doctest: +SKIP
    >>> fleet.numbers["frictionloss_calf"].scatter      # doctest: +SKIP
    0.19
    """
    named = dict(fits) if isinstance(fits, Mapping) else dict(_named(items("fits", fits, "gaitfit.FitResult or run folders")))
    results = {str(name): _fits(str(name), one) for name, one in named.items()}
    if len(results) < MIN_ROBOTS:
        raise ValueError(f"there are {len(results)} robots; the scatter of a fleet needs at least {MIN_ROBOTS}")
    every = [one for several in results.values() for one in several]
    everywhere = [name for name in every[0].parameters if all(name in one.parameters for one in every)]
    if not everywhere:
        raise ValueError("the fits have no number in common: fit all robots with the same parameters")
    left_out = {name: "not all robots have it" for one in every for name in one.parameters if name not in everywhere}
    numbers: list[dict[str, Any]] = []
    robots: dict[str, dict[str, Any]] = {robot: {} for robot in results}
    for name in everywhere:
        number, estimates = _number({robot: [one.parameters[name] for one in several] for robot, several in results.items()})
        numbers.append(asdict(number))
        for robot, estimate in estimates.items():
            robots[robot][name] = asdict(estimate)
    document = {
        "headline": _headline(len(results), numbers),
        "numbers": numbers,
        "robots": robots,
        "left_out": left_out,
        "folders": {robot: [str(one.run_folder) for one in several] for robot, several in results.items()},
    }
    return fleet_result(document)


def _named(fits: list[Any]) -> list[tuple[str, Any]]:
    """Fits with the names of their runs; equal names get a number."""
    found: list[tuple[str, Any]] = []
    for one in fits:
        first = one[0] if isinstance(one, (list, tuple)) and one else one
        name = first.name if isinstance(first, FitResult) else Path(first).name if isinstance(first, (str, os.PathLike)) else str(first)
        several = sum(other == name or other.startswith(f"{name} (") for other, _ in found)
        found.append((f"{name} ({several + 1})" if several else name, one))
    return found


def _fits(robot: str, fits: object) -> list[FitResult]:
    """The fits of a robot."""
    results: list[FitResult] = []
    for fit in fits if isinstance(fits, (list, tuple)) else [fits]:
        result = load(fit) if isinstance(fit, (str, os.PathLike)) else fit
        if not isinstance(result, FitResult):
            raise TypeError(f"the robot {robot} has a {type(result).__name__}; give a gaitfit.FitResult or a fit's run folder")
        results.append(result)
    if not results:
        raise ValueError(f"the robot {robot} has no fit: give one, or leave the robot out")
    return results


def _number(fits: Mapping[str, list[FittedParameter]]) -> tuple[FleetNumber, dict[str, FleetEstimate]]:
    """One number's distribution, and the estimates of all robots."""
    parameters = [one for several in fits.values() for one in several]
    lower, upper = min(one.lower for one in parameters), max(one.upper for one in parameters)
    each = [[(one.value, standard_error(one, f"the robot {robot}")) for one in several] for robot, several in fits.items()]
    scale: Scale = "absolute"
    calibration, values, errors = _joined(each)
    plain = [value for several in each for value, _ in several]
    if lower >= 0 and min(plain) > SMALL * float(np.median(plain)):
        relative = _joined([[scaled("relative", *one) for one in several] for several in each])
        if float(np.median(relative[2])) < MAX_RELATIVE:
            scale, (calibration, values, errors) = "relative", relative
    hierarchy = Hierarchy.of(values, errors)
    center, scatter = float(hierarchy.center().mean), hierarchy.scatter(0.5)

    def read(value: Array | float) -> float:
        return float(np.exp(min(float(value), 700.0))) if scale == "relative" else float(value)

    def interval(mixture: Any) -> Interval:
        return read(mixture.quantile(0.025)), read(mixture.quantile(0.975))

    number = FleetNumber(
        name=parameters[0].name,
        unit=parameters[0].unit,
        scale=scale,
        center=read(center),
        center_interval=interval(hierarchy.center()),
        scatter=scatter,
        scatter_interval=(hierarchy.scatter(0.025), hierarchy.scatter(0.975)),
        another=interval(hierarchy.another()),
        lower=lower,
        upper=upper,
        calibration=calibration,
    )
    mixture, shares = hierarchy.members(values, errors)
    means, ends = mixture.mean, (mixture.quantile(0.025), mixture.quantile(0.975))
    away = (values - center) / np.hypot(scatter, errors)
    estimates = {
        robot: FleetEstimate(
            name=number.name,
            unit=number.unit,
            value=unscaled(number, float(means[at])),
            interval=(unscaled(number, float(ends[0][at])), unscaled(number, float(ends[1][at]))),
            alone=read(values[at]),
            alone_error=float(errors[at]) * (read(values[at]) if scale == "relative" else 1.0),
            own_share=float(shares[at]),
            away=float(away[at]),
        )
        for at, robot in enumerate(fits)
    }
    return number, estimates


def _joined(each: list[list[tuple[float, float]]]) -> tuple[float, Array, Array]:
    """The calibration of the standard errors, and for each robot the mean of its estimates with its standard error.

    Estimates weigh by their squared errors. The calibration is the root of χ² over its degrees of freedom, of all robots'
    estimates around their means; 1 without repeated fits.
    """
    values, errors = np.array([mean_of(several) for several in each]).T
    free = sum(len(several) - 1 for several in each)
    chi = sum(((own - mean) / error) ** 2 for several, mean in zip(each, values) for own, error in several)
    calibration = float(np.sqrt(chi / free)) if free else 1.0
    # Estimates that agree to the last digit leave no error; a hundredth is beyond what repeats can show.
    calibration = max(calibration, 0.01)
    return calibration, values, calibration * errors


def _headline(robots: int, numbers: list[dict[str, Any]]) -> str:
    relative = [one["scatter"] for one in numbers if one["scale"] == "relative"]
    scatter = f"; positive numbers scatter by {100 * min(relative):.0f} to {100 * max(relative):.0f} %" if relative else ""
    return f"{len(numbers)} numbers of {robots} robots{scatter}."
