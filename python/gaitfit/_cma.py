"""CMA-ES alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._alone import Alone
from ._arguments import MAX_POPULATION, count, maybe, text
from ._arrays import numbers
from ._gaitfit import Cma as _Cma

#: Coordinates: a full covariance has the square of them as numbers.
MAX_FULL, MAX_SEPARABLE = 4096, 1_000_000


class CMA:
    """Minimises a black box by CMA-ES (Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv 1604.00772, 2016).

    >>> search = CMA(start=[3.0, -2.0], deviation=[1.0, 0.1], seed=7)
    >>> while search.stop is None:
    ...     candidates = search.ask()                 # shape (population, n)
    ...     search.tell(candidates[:, 0] ** 2 + 100 * candidates[:, 1] ** 2)
    >>> search.best_cost < 1e-9
    True

    Arguments:
        start: The first mean, one number for each coordinate, in the problem's own units.
        deviation: The first standard deviation, one number for each coordinate.
        seed: The same seed gives the same candidates.
        lower, upper: Bounds, one number for each coordinate.
        population: Candidates a generation; by default 4 + ⌊3 ln n⌋ for n coordinates.
        bounds: What happens to draws beyond a bound: ``"resample"`` or ``"reflect"``.
        covariance: ``"full"``, or for hundreds of coordinates ``"separable"``.
        state: :attr:`state` of an earlier search with the same arguments, which this one continues.

    Raises ``ValueError`` and ``TypeError`` for wrong arguments. A search can be pickled.
    """

    def __init__(
        self,
        start: ArrayLike,
        deviation: ArrayLike,
        *,
        seed: int = 1,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        population: int | None = None,
        bounds: Literal["resample", "reflect"] = "resample",
        covariance: Literal["full", "separable"] = "full",
        state: str | None = None,
    ) -> None:
        if bounds not in ("resample", "reflect"):
            raise ValueError(f"bounds is {bounds!r}; take 'resample' or 'reflect'")
        if covariance not in ("full", "separable"):
            raise ValueError(f"covariance is {covariance!r}; take 'full' or 'separable'")
        first = _numbers("start", start)
        most = MAX_FULL if covariance == "full" else MAX_SEPARABLE
        if len(first) > most:
            other = "; take covariance='separable'" if len(first) <= MAX_SEPARABLE else ""
            raise ValueError(f"start has {len(first)} coordinates; a {covariance} covariance takes at most {most}{other}")
        self._arguments = (
            first,
            _numbers("deviation", deviation),
            count("seed", seed, 0),
            None if lower is None else _numbers("lower", lower),
            None if upper is None else _numbers("upper", upper),
            None if population is None else count("population", population, 2, MAX_POPULATION),
            bounds == "reflect",
            covariance == "separable",
        )
        self._search, self._alone = _Cma(*self._arguments, maybe(text, "state", state)), Alone("search")

    def __getstate__(self) -> tuple[Any, ...]:
        return (*self._arguments, self.state)

    def __setstate__(self, saved: tuple[Any, ...]) -> None:
        self._arguments = saved[:-1]
        self._search, self._alone = _Cma(*saved), Alone("search")

    def ask(self) -> NDArray[np.float64]:
        """The candidates of this generation, shape ``(population, n)``: the same ones until :meth:`tell`."""
        with self._alone():
            return self._search.ask()

    def tell(self, costs: ArrayLike) -> None:
        """Takes ``costs`` of the candidates of :meth:`ask`, shape ``(population,)``; infinity for one that failed.

        Raises ``ValueError`` for another number of costs, and without :meth:`ask` before it.
        """
        array = numbers("costs", costs, np.float64)
        if array.ndim != 1:
            raise ValueError(f"costs has the shape {array.shape}; needed: one number for each candidate")
        with self._alone():
            self._search.tell(array)

    @property
    def stop(self) -> str | None:
        """Why the search has ended, or ``None`` while it continues."""
        return self._search.stop()

    @property
    def best(self) -> NDArray[np.float64] | None:
        """The best candidate so far, shape ``(n,)``."""
        best = self._search.best()
        return None if best is None else best[0]

    @property
    def best_cost(self) -> float | None:
        """What it cost."""
        best = self._search.best()
        return None if best is None else best[1]

    @property
    def mean(self) -> NDArray[np.float64]:
        """The mean of the distribution, shape ``(n,)``."""
        return self._search.mean()

    @property
    def deviations(self) -> NDArray[np.float64]:
        """The standard deviation of each coordinate, shape ``(n,)``."""
        return self._search.deviations()

    @property
    def generation(self) -> int:
        """Generations so far."""
        return self._search.generation()

    @property
    def evaluations(self) -> int:
        """Candidates so far."""
        return self._search.evaluations()

    @property
    def state(self) -> str:
        """All that changes, as JSON: small, exact, and enough to continue later."""
        return self._search.state()


def _numbers(what: str, values: ArrayLike) -> Sequence[float]:
    array = numbers(what, values, np.float64)
    if array.ndim != 1:
        raise ValueError(f"{what}: needed: one number for each coordinate; found an array of shape {array.shape}")
    found: list[float] = array.tolist()
    return found
