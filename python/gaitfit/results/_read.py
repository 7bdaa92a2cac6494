"""Results from plain data and files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._arguments import path as named
from .._decode import decoded
from ._fit import Cause, Explanation, FitResult, ValidationResult
from ._fleet import Fleet, fleet_result
from ._loop import Comparison, LoopResult, Measurement, Round, Table, TableRow
from ._walk import Collection, Evaluation, Training

#: What :func:`load` returns.
Loaded = FitResult | Training | Evaluation | LoopResult | ValidationResult | Table | Fleet


def load(run: str | os.PathLike[str]) -> Loaded:
    """The result of an earlier run.

    ``run`` is a run folder, its ``result.json``, a fleet's file (:meth:`Fleet.write`), or a file with the output of ``--json``.
    The file determines the kind of result: test it with ``isinstance``.

    Returns what the stage returned.

    Raises ``FileNotFoundError`` if there is no such file or the run has no result yet, and ``ValueError`` for a file that
    is not a result.

    >>> result = gaitfit.load("runs/adapt")      # doctest: +SKIP
    >>> isinstance(result, gaitfit.FitResult)      # doctest: +SKIP
    True
    """
    file = Path(named("run", run))
    if file.is_dir():
        if not (file / "result.json").exists():
            inside = sorted(one.parent.name for one in file.glob("*/result.json"))
            runs = f". Run folders in it: {', '.join(inside[:20])}" if inside else ""
            raise FileNotFoundError(f"{file} has no result.json: it is no run folder, or its run has not ended yet{runs}")
        file = file / "result.json"
    if not file.exists():
        raise FileNotFoundError(f"there is no {file}; give a run folder, its result.json, a fleet's file, or a file with the output of --json")
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as wrong:
        raise ValueError(f"{file} is no JSON: {wrong}; give a run folder or its result.json") from wrong
    if isinstance(document, dict) and isinstance(document.get("results"), dict):
        document = document["results"]
    try:
        return _of_any(document)
    except (KeyError, TypeError, ValueError, AttributeError) as wrong:
        raise ValueError(f"{file} is no result of gaitfit: {wrong}") from wrong


def fit_result(document: Mapping[str, Any]) -> FitResult:
    """A fit's document as a result."""
    return decoded(FitResult, document, document=dict(document))


def explanation_result(document: Mapping[str, Any]) -> Explanation:
    """An explanation's document as a result."""
    causes = tuple(decoded(Cause, {**one, **one["size"]}) for one in document["causes"])
    return decoded(Explanation, document, document=dict(document), causes=causes)


def validation_result(document: Mapping[str, Any]) -> ValidationResult:
    """A validation's document as a result."""
    return decoded(ValidationResult, document, document=dict(document))


def training_result(document: Mapping[str, Any]) -> Training:
    """A training's document as a result."""
    return decoded(Training, document, document=dict(document), num_envs=document["environments"])


def evaluation_result(document: Mapping[str, Any]) -> Evaluation:
    """An evaluation's document as a result."""
    return decoded(Evaluation, document, document=dict(document))


def collection_result(document: Mapping[str, Any]) -> Collection:
    """A collection's document as a result."""
    return decoded(Collection, document, document=dict(document))


def loop_result(document: Mapping[str, Any]) -> LoopResult:
    """A loop's document as a result."""
    rounds = tuple(
        decoded(Round, one, fit=fit_result(one["adapt"]), training=training_result(one["finetune"]))
        for one in document["rounds"]
    )
    evaluations = tuple(decoded(Measurement, one, document=dict(one)) for one in document["evaluations"])
    comparisons = tuple(comparison_result(one) for one in document["comparisons"])
    return decoded(
        LoopResult, document, document=dict(document), rounds=rounds, evaluations=evaluations, comparisons=comparisons
    )


def comparison_result(document: Mapping[str, Any]) -> Comparison:
    """A comparison's document as a result."""
    return decoded(Comparison, document, document=dict(document))


def table_result(document: Mapping[str, Any]) -> Table:
    """A table's document as a result."""
    cells = tuple(decoded(TableRow, one) for one in document["rows"])
    return decoded(Table, document, document=dict(document), cells=cells)


def _of_any(document: Mapping[str, Any]) -> Loaded:
    if "folders" in document:
        return fleet_result(document)
    if "rounds" in document:
        return loop_result(document)
    if "fits" in document:
        return fit_result(document)
    if "seeds" in document:
        return training_result(document)
    if "table" in document:
        return table_result(document)
    if "validation" in document:
        return validation_result(document)
    if "linear_velocity_error" in document:
        return evaluation_result(document)
    raise ValueError(f"it has {', '.join(map(str, document)) or 'nothing'}")
