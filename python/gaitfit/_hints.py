"""Names of types for hints, where what they are from need not be installed: ``typing.get_type_hints`` finds them."""

from __future__ import annotations

from typing import Any


class pd:
    """pandas."""

    DataFrame = Any


class torch:
    """PyTorch."""

    class nn:
        """Its networks."""

        Module = Any


Figure = Any
FitOutcome = Any
LoadedPolicy = Any
Self = Any
