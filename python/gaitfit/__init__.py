"""Fits a legged robot's simulator to logs of the real robot, and trains its policy there.

Stages: :func:`fit`, :func:`validate`, :func:`train`, :func:`finetune`, :func:`evaluate`, :func:`collect`, :func:`loop`.
Their results: :mod:`gaitfit.results`; :func:`load` reads them from a run folder.
Parts: :func:`read_log`, :mod:`gaitfit.costs`, :class:`CMA`, :class:`Policy` (a policy of your own),
:func:`fit_simulator` (a simulator of your own) and :mod:`gaitfit.mujoco` (official MuJoCo as one), :class:`Robots` (many
robots at a task), :mod:`gaitfit.gym` and :mod:`gaitfit.rsl_rl` (the same as other libraries take them).
"""

from typing import TYPE_CHECKING, Any

from ._gaitfit import DeviceArray, GaitfitError, __version__

if TYPE_CHECKING:
    from . import costs, results
    from ._cma import CMA
    from ._logs import Log, read_log
    from ._own_simulator import FitOutcome, Parameter, Simulator, fit_simulator
    from ._policy import Interface, Policy, Term
    from ._robots import Robots
    from ._stages import collect, evaluate, finetune, fit, loop, train, validate
    from .results import (
        Collection,
        Evaluation,
        FitResult,
        FittedParameter,
        LoopResult,
        Training,
        ValidationResult,
        load,
    )

__all__ = [
    "CMA",
    "Collection",
    "DeviceArray",
    "Evaluation",
    "FitOutcome",
    "FitResult",
    "FittedParameter",
    "GaitfitError",
    "Interface",
    "Log",
    "LoopResult",
    "Parameter",
    "Policy",
    "Robots",
    "Simulator",
    "Term",
    "Training",
    "ValidationResult",
    "__version__",
    "collect",
    "costs",
    "evaluate",
    "finetune",
    "fit",
    "fit_simulator",
    "load",
    "loop",
    "read_log",
    "results",
    "train",
    "validate",
]

#: Where what needs NumPy is: it is imported when it is asked for, so that the program starts without.
_PARTS = {
    "_cma": ("CMA",),
    "_logs": ("Log", "read_log"),
    "_own_simulator": ("FitOutcome", "Parameter", "Simulator", "fit_simulator"),
    "_policy": ("Interface", "Policy", "Term"),
    "_robots": ("Robots",),
    "_stages": ("collect", "evaluate", "finetune", "fit", "loop", "train", "validate"),
    "costs": ("costs",),
    "results": (
        "results",
        "Collection",
        "Evaluation",
        "FitResult",
        "FittedParameter",
        "LoopResult",
        "Training",
        "ValidationResult",
        "load",
    ),
}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    for part, names in _PARTS.items():
        if name in names:
            module = import_module(f".{part}", __name__)
            found = module if part == name else getattr(module, name)
            globals()[name] = found
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
