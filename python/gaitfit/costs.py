"""Distances of joint signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import numbers
from ._gaitfit import wasserstein as _wasserstein

__all__ = ["wasserstein"]


def wasserstein(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64] | float:
    """The 1-D Wasserstein-1 distance between two samples, exact (the area between their distribution functions; as
    ``scipy.stats.wasserstein_distance``).

    ``a`` and ``b`` have shape ``(samples,)``, or ``(samples, dimensions)``: then there is one distance for each
    dimension, shape ``(dimensions,)``. The numbers of samples may differ. The distance has the signals' unit. All is
    computed in 64 bits, and exchanging ``a`` and ``b`` changes nothing.

    Returns one number, or one for each dimension.

    Raises ``ValueError`` for samples that are empty, not finite, or of different dimensions.

    >>> wasserstein([0.0, 1.0], [2.0, 3.0])
    2.0
    """
    first, second = numbers("a", a, np.float64), numbers("b", b, np.float64)
    if first.ndim != second.ndim or first.ndim not in (1, 2):
        raise ValueError(f"a has {first.ndim} axes and b has {second.ndim}; both need one, or both two")
    if first.ndim == 1:
        return _wasserstein(first[:, None], second[:, None])[0]
    return np.asarray(_wasserstein(first, second))
