"""Arrays that users give."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


def numbers(what: str, values: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """Real numbers as an array of ``dtype``, in the shape that they have; ``TypeError`` for texts, complex numbers and what is no array."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, RuntimeError) as error:
        raise TypeError(f"{what}: no array of numbers: {error}") from error
    if array.dtype.kind not in "buif":
        kind = {"c": "complex numbers", "U": "texts", "S": "texts"}.get(array.dtype.kind, f"elements of type {array.dtype}")
        raise TypeError(f"{what}: {kind} stand where real numbers are needed")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, dtype).reshape(array.shape)
