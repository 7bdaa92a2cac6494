"""What all results have."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
else:
    from .._hints import Figure, pd

Interval = tuple[float, float]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Estimate:
    """A mean with its confidence interval.

    Attributes:
        mean: The mean; NaN if nothing was measured.
        ci95: Half the width of the mean's 95 % confidence interval; NaN with a single sample.

    >>> walked.fall_rate.mean
    0.0
    """

    mean: float
    ci95: float = math.nan


@dataclass(frozen=True)
class Doubt:
    """A reason not to use a result as it is.

    Attributes:
        kind: Its kind in snake case, for example ``"not_converged"``.
        text: The evidence in a sentence or two.
        details: Further text for whoever corrects the cause, for example a program's error message.

    >>> [doubt.kind for doubt in result.doubts if "generations" in doubt.text]
    ['not_converged']
    """

    kind: str
    text: str
    details: str = ""


@dataclass(frozen=True)
class Check:
    """A check that the settings ask for.

    Attributes:
        name: What is checked.
        passed: Whether the check passed.
        limit: The limit, or ``None`` for a check without one.
        value: The measured value, or ``None`` if there is none.

    >>> {check.name: check.passed for check in result.checks}["converged"]
    False
    """

    name: str
    passed: bool
    limit: float | None = None
    value: float | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class Result:
    """What all results have. Results can be compared with ``==``, copied and pickled.

    Attributes:
        document: The document that the program prints with ``--json``, as plain data.

    >>> result.to_dict()["robot"]
    'go2'
    >>> result.rows()[0]["name"]
    'frictionloss_hip'
    """

    document: dict[str, Any] = field(compare=False)

    def __repr__(self) -> str:
        text = self._headline()
        return f"{type(self).__name__}({text})"

    def to_dict(self) -> dict[str, Any]:
        """The document as plain data, as JSON has it: a copy."""
        return copy.deepcopy(self.document)

    def to_json(self, indent: int | None = None) -> str:
        """The document as JSON. ``indent`` is the number of spaces for each level, as for :func:`json.dumps`. Raises ``TypeError`` for
        an ``indent`` that is not a number."""
        return json.dumps(self.document, indent=indent, ensure_ascii=False)

    def rows(self) -> list[dict[str, Any]]:
        """The result as a table: one flat row for each parameter, log, seed, policy or file. Names of inner numbers have dots
        (``"fall_rate.mean"``)."""
        raise NotImplementedError

    def to_dataframe(self) -> pd.DataFrame:
        """:meth:`rows` as a ``pandas.DataFrame``. Raises ``ImportError`` without pandas."""
        try:
            import pandas
        except ImportError as missing:
            raise ImportError("to_dataframe() needs pandas: pip install pandas. rows() needs nothing") from missing
        return pandas.DataFrame(self.rows(), columns=self._columns() if not self.rows() else None)

    def _columns(self) -> list[str] | None:
        """The columns of a table without rows."""
        return None

    @property
    def report(self) -> Path | None:
        """The run's page, or ``None`` if there is none."""
        folder = self.document.get("run_folder")
        page = None if folder is None else Path(folder) / "report.html"
        return page if page is not None and page.exists() else None

    def plot(self) -> Figure:
        """The result's chart (:func:`gaitfit.plots.plot`). Needs ``matplotlib``."""
        from ..plots import plot

        return plot(self)

    def _headline(self) -> str:
        return str(self.document.get("headline") or self.document.get("name") or "")

    def _repr_html_(self) -> str:
        """In a notebook: the headline, and the run's page in a frame."""
        import html

        page = self.report
        frame = "" if page is None else framed(page)
        return f"<p>{html.escape(self._headline())}</p>{frame}"


def framed(page: Path, height: int = 600) -> str:
    """A page as an HTML frame that needs no other file."""
    # Imported here, because most programs show no pages, and each import makes their start slower.
    import html

    text = html.escape(page.read_text(encoding="utf-8"), quote=True)
    # Scripts draw the page's charts; they reach nothing outside it.
    return f'<iframe srcdoc="{text}" sandbox="allow-scripts" width="100%" height="{height}" style="border:0"></iframe>'


def flat(row: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """A row without objects and lists in it: inner names follow a dot, and lists are left out."""
    cells: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, dict):
            cells.update(flat(value, f"{before}{key}."))
        elif not isinstance(value, list):
            cells[before + key] = value
    return cells


def lines(file: Path) -> list[dict[str, Any]]:
    """The lines of a run's metrics."""
    if not file.exists():
        raise FileNotFoundError(f"there is no {file}: the run folder was moved or removed")
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
