"""Fits a legged robot's simulator to logs of the real robot, and trains its policy there.

Stages: :func:`fit`, :func:`validate`, :func:`train`, :func:`finetune`, :func:`evaluate`, :func:`collect`, :func:`loop`.
Parts: :func:`read_log`, :mod:`gaitfit.costs`, :class:`CMA`, :class:`Policy` (a policy of your own),
:func:`fit_simulator` (a simulator of your own) and :mod:`gaitfit.mujoco` (official MuJoCo as one), :class:`Robots` (many
robots at a task), :mod:`gaitfit.gym` and :mod:`gaitfit.rsl_rl` (the same as other libraries take them).
"""

from typing import TYPE_CHECKING, Any

from ._gaitfit import DeviceArray, GaitfitError, __version__

if TYPE_CHECKING:
    from . import costs
    from ._cma import CMA
    from ._logs import Log, read_log
    from ._own_simulator import FitOutcome, Parameter, Simulator, fit_simulator
    from ._policy import Interface, Policy, Term
    from ._results import Results
    from ._robots import Robots
    from ._stages import collect, evaluate, finetune, fit, loop, train, validate

__all__ = [
    "CMA",
    "DeviceArray",
    "FitOutcome",
    "GaitfitError",
    "Interface",
    "Log",
    "Parameter",
    "Policy",
    "Results",
    "Robots",
    "Simulator",
    "Term",
    "__version__",
    "collect",
    "costs",
    "evaluate",
    "finetune",
    "fit",
    "fit_simulator",
    "loop",
    "read_log",
    "train",
    "validate",
]

#: Where what needs NumPy is: it is imported when it is asked for, so that the program starts without.
_PARTS = {
    "_cma": ("CMA",),
    "_logs": ("Log", "read_log"),
    "_own_simulator": ("FitOutcome", "Parameter", "Simulator", "fit_simulator"),
    "_policy": ("Interface", "Policy", "Term"),
    "_results": ("Results",),
    "_robots": ("Robots",),
    "_stages": ("collect", "evaluate", "finetune", "fit", "loop", "train", "validate"),
    "costs": ("costs",),
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
