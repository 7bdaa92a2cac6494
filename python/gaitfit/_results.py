"""What a stage found."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Results(Mapping[str, Any]):
    """What a stage found: the document that the program prints with ``--json``, also by attribute.

    ``results["headline"]`` and ``results.headline`` are the same. ``dict(results)`` is plain data. Notebooks show the
    run's page.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self._document = dict(document)

    def __getitem__(self, key: str) -> Any:
        return _wrapped(self._document[key])

    def __getattr__(self, key: str) -> Any:
        if key.startswith("_"):
            raise AttributeError(key)
        try:
            return self[key]
        except KeyError:
            have = ", ".join(self._document)
            raise AttributeError(f"there is no {key!r}; there are {have}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._document]

    def __iter__(self) -> Iterator[str]:
        return iter(self._document)

    def __len__(self) -> int:
        return len(self._document)

    def __repr__(self) -> str:
        headline = self._document.get("headline")
        text = f": {headline}" if headline else ""
        return f"Results({', '.join(self._document)}){text}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as JSON has it."""
        return dict(self._document)

    @property
    def report(self) -> Path | None:
        """The page of the run, where there is one."""
        folder = self._document.get("run_folder")
        page = None if folder is None else Path(folder) / "report.html"
        return page if page is not None and page.exists() else None

    def plot(self) -> Figure:
        """The chart of these results (:func:`gaitfit.plots.plot`), for notebooks. Needs ``matplotlib``."""
        from .plots import plot

        return plot(self.to_dict())

    def _repr_html_(self) -> str:
        """In a notebook: the headline, and the run's page in a frame."""
        headline = self._document.get("headline") or self._document.get("verdict") or ", ".join(self._document)
        page = self.report
        frame = "" if page is None else framed(page)
        return f"<p>{html.escape(str(headline))}</p>{frame}"

    def rows(self, key: str) -> list[dict[str, Any]]:
        """The list under ``key`` as flat rows, for ``pandas.DataFrame`` or ``polars.DataFrame``."""
        rows = self._document.get(key)
        if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
            lists = [name for name, value in self._document.items() if isinstance(value, list)]
            raise ValueError(f"these results have no rows {key!r}; there are {', '.join(lists) or 'none'}")
        return [_flat(row) for row in rows]


def framed(page: Path, height: int = 600) -> str:
    """A page as an HTML frame that needs no other file."""
    text = html.escape(page.read_text(encoding="utf-8"), quote=True)
    # Scripts draw the page's charts; they reach nothing outside it.
    return f'<iframe srcdoc="{text}" sandbox="allow-scripts" width="100%" height="{height}" style="border:0"></iframe>'


def _wrapped(value: Any) -> Any:
    if isinstance(value, dict):
        return Results(value)
    if isinstance(value, list):
        return [_wrapped(one) for one in value]
    return value


def _flat(row: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{before}{key}."))
        else:
            flat[before + key] = value
    return flat
