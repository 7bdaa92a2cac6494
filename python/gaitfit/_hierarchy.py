"""Estimates of one number on several robots, and the distribution of its true values over such robots.

The estimate of robot i is y_i with standard error s_i. The true values are normal with a common mean and a common standard
deviation, the scatter:  y_i ~ N(x_i, s_i²),  x_i ~ N(mean, scatter²). Mean and scatter have uniform priors. The mean is
integrated in closed form and the scatter on a grid (Gelman and others, Bayesian Data Analysis, 3rd edition 2013, section 5.4,
equations 5.17 to 5.21). The density of the scatter is then the restricted likelihood that REML maximises. Few robots leave the
scatter uncertain; because it is integrated, intervals are wider then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Points of the scatter.
GRID = 200
#: Points with less than this share of the greatest weight are left out.
NEGLIGIBLE = 1e-7
#: Robots below which the density of the scatter cannot be normalised (Gelman 2006, Bayesian Analysis 1, section 5.2: at least 3).
MIN_ROBOTS = 4


@dataclass(frozen=True)
class Mixture:
    """Weighted normal distributions, one for each point of the scatter's grid. The last axis is the grid."""

    means: Array
    deviations: Array
    weights: Array

    @property
    def mean(self) -> Array:
        return np.asarray((self.weights * self.means).sum(-1))

    def quantile(self, probability: float) -> Array:
        """The value below which this share of the probability lies."""
        lower = (self.means - 6.0 * self.deviations).min(-1)
        upper = (self.means + 6.0 * self.deviations).max(-1)
        for _ in range(40):
            middle = 0.5 * (lower + upper)
            below = (self.weights * normal((middle[..., None] - self.means) / self.deviations)).sum(-1) < probability
            lower, upper = np.where(below, middle, lower), np.where(below, upper, middle)
        return np.asarray(0.5 * (lower + upper))


@dataclass(frozen=True)
class Hierarchy:
    """The distribution of one number over robots, as their estimates show it.

    Attributes:
        scatters: Grid of the scatter, all above 0.
        weights: Probability of each point of the grid.
        means, variances: Mean and variance of the common mean, given each scatter.
    """

    scatters: Array
    weights: Array
    means: Array
    variances: Array

    @classmethod
    def of(cls, values: Array, errors: Array) -> Hierarchy:
        """The distribution that at least :data:`MIN_ROBOTS` estimates ``values`` with standard errors ``errors`` show."""
        scale = max(float(np.std(values)), float(np.median(errors)))
        # The grid reaches from 0 to infinity: scatter = scale · u / (1 − u).
        u = (np.arange(GRID) + 0.5) / GRID
        scatters, step = scale * u / (1.0 - u), scale / (1.0 - u) ** 2
        total = errors[:, None] ** 2 + scatters**2
        variances = 1.0 / (1.0 / total).sum(0)
        means = variances * (values[:, None] / total).sum(0)
        away = (values[:, None] - means) ** 2 / total
        logs = np.log(step) + 0.5 * np.log(variances) - 0.5 * (np.log(total) + away).sum(0)
        weights = np.exp(logs - logs.max())
        kept = weights > NEGLIGIBLE
        weights = weights[kept] / weights[kept].sum()
        return cls(scatters[kept], weights, means[kept], variances[kept])

    def scatter(self, probability: float) -> float:
        """The scatter below which this share of the probability lies."""
        return float(np.interp(probability, np.cumsum(self.weights) - 0.5 * self.weights, self.scatters))

    def center(self) -> Mixture:
        """The common mean."""
        return Mixture(self.means, np.sqrt(self.variances), self.weights)

    def another(self) -> Mixture:
        """The true value of another robot, before any log of it."""
        return Mixture(self.means, np.sqrt(self.scatters**2 + self.variances), self.weights)

    def members(self, values: Array, errors: Array) -> tuple[Mixture, Array]:
        """The true values of the robots themselves, and the share of each that its own estimate has."""
        own = self.scatters**2 / (errors[:, None] ** 2 + self.scatters**2)
        means = own * values[:, None] + (1.0 - own) * self.means
        variances = own * errors[:, None] ** 2 + (1.0 - own) ** 2 * self.variances
        return Mixture(means, np.sqrt(variances), self.weights), np.asarray((self.weights * own).sum(-1))

    def with_estimate(self, value: float, error: float) -> tuple[Mixture, float]:
        """The true value of another robot with an estimate of its own, and the share that this estimate has.

        The product of two normal densities, which is exact. The estimate's likelihood changes the scatter's density, too.
        """
        prior = self.scatters**2 + self.variances
        own = prior / (prior + error**2)
        logs = np.log(self.weights) - 0.5 * (np.log(prior + error**2) + (value - self.means) ** 2 / (prior + error**2))
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        mixture = Mixture(own * value + (1.0 - own) * self.means, np.sqrt(own) * error, weights)
        return mixture, float((weights * own).sum())


def normal(x: Array) -> Array:
    """Distribution function of the standard normal, to 1e-7 (Abramowitz and Stegun 1964, equation 26.2.17)."""
    t = 1.0 / (1.0 + 0.2316419 * np.abs(x))
    series = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * np.minimum(x**2, 1400.0)) / np.sqrt(2.0 * np.pi) * series
    return np.asarray(np.where(x > 0, 1.0 - tail, tail))
