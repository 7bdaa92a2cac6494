"""The results of the stages: frozen dataclasses whose fields have types, units and documentation.

Every stage has its own: :func:`gaitfit.fit` a :class:`FitResult`, :func:`gaitfit.validate` a :class:`ValidationResult`,
:func:`gaitfit.train` and :func:`gaitfit.finetune` a :class:`Training`, :func:`gaitfit.evaluate` an :class:`Evaluation`,
:func:`gaitfit.collect` a :class:`Collection`, :func:`gaitfit.explain` an :class:`Explanation`, :func:`gaitfit.compare` a
:class:`Comparison`, :func:`gaitfit.loop` a :class:`LoopResult`, :func:`gaitfit.fleet` a :class:`Fleet`, and
:func:`gaitfit.ray.reproduce` a :class:`Table`. :func:`load` reads a result from a run folder.

Files are :class:`pathlib.Path`. If a number could not be measured, a mean is NaN, and other fields are ``None`` as their
descriptions state. :attr:`Result.document` is the whole document that the program prints with ``--json``. It has more detail than
the fields.
"""

from .._decode import Named
from ._base import Check, Doubt, Estimate, Result
from ._fit import (
    Cause,
    CostFit,
    Explanation,
    FitResult,
    FittedParameter,
    HeldOut,
    Prior,
    Score,
    Sharing,
    Spring,
    ValidatedLog,
    ValidationResult,
)
from ._fleet import Fleet, FleetEstimate, FleetNumber
from ._loop import Comparison, LoopResult, Measurement, Round, Table, TableRow
from ._read import load
from ._walk import Collection, Diagnosis, Drift, Evaluation, Gait, SeedResult, Training

__all__ = [
    "Cause",
    "Check",
    "Collection",
    "Comparison",
    "CostFit",
    "Diagnosis",
    "Doubt",
    "Drift",
    "Estimate",
    "Evaluation",
    "Explanation",
    "FitResult",
    "FittedParameter",
    "Fleet",
    "FleetEstimate",
    "FleetNumber",
    "Gait",
    "HeldOut",
    "LoopResult",
    "Measurement",
    "Named",
    "Prior",
    "Result",
    "Round",
    "Score",
    "SeedResult",
    "Sharing",
    "Spring",
    "Table",
    "TableRow",
    "Training",
    "ValidatedLog",
    "ValidationResult",
    "load",
]
