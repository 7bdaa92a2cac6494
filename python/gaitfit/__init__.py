"""Fits a legged robot's simulator to logs of the real robot, and trains its policy there.

Stages: :func:`fit`, :func:`validate`, :func:`train`, :func:`finetune`, :func:`evaluate`, :func:`collect`, :func:`loop`; beside them
:func:`explain` (what a model lacks, from logs) and :func:`compare` (two evaluations).
Their results: :mod:`gaitfit.results`; :func:`load` reads them from a run folder.
Their settings as dataclasses: :mod:`gaitfit.config`; functions for ``progress=``: :mod:`gaitfit.callbacks`.
Logs: :func:`read_log`, :class:`Log` (of arrays and tables); charts: :mod:`gaitfit.plots`.
Policies: :func:`load_policy` (a file that acts), :class:`Observer` (its observations in a loop of your own), :class:`Policy` (a
function of yours).
Robot files: :func:`read_robot`. Robots at a task: :class:`Robots`; as other libraries take them :mod:`gaitfit.gym`, :mod:`gaitfit.sb3` and :mod:`gaitfit.rsl_rl`. Rewards and ends of
episodes of your own, there and in trainings: :class:`Terms`.
Simulators of your own: :func:`fit_simulator`; official MuJoCo as one: :mod:`gaitfit.mujoco`, :mod:`gaitfit.mujoco_warp`.
More: :func:`fleet` (many robots of one kind), :mod:`gaitfit.ray` (many machines), :class:`CMA`, :mod:`gaitfit.costs`.

``help(gaitfit.fit)`` shows arguments, results, errors and an example; so does every function and class.
"""

from typing import TYPE_CHECKING, Any

from ._gaitfit import DeviceArray, GaitfitError, Stopped, __version__

if TYPE_CHECKING:
    from . import callbacks, config, costs, results
    from . import gym as gym
    from . import mujoco as mujoco
    from . import plots as plots
    from ._cma import CMA
    from ._fleet import fleet
    from ._log_files import read_log
    from ._logs import Finding, Log
    from ._observer import Observer
    from ._own_simulator import FitOutcome, Parameter, Simulator, fit_simulator
    from ._policy import Interface, Policy, Term
    from ._policy_file import LoadedPolicy, load_policy
    from ._progress import Event
    from ._robot_file import RobotFile, RobotJoint, read_robot
    from ._robots import Robots
    from ._robots_state import Motion, RobotsState
    from ._training_terms import TrainingRobots
    from ._terms import Terms
    from ._stages import compare, explain, fit, loop, validate
    from ._walks import collect, evaluate, finetune, train
    from .results import (
        Collection,
        Evaluation,
        FitResult,
        FittedParameter,
        Fleet,
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
    "Event",
    "Finding",
    "FitOutcome",
    "FitResult",
    "FittedParameter",
    "Fleet",
    "GaitfitError",
    "Interface",
    "LoadedPolicy",
    "Log",
    "LoopResult",
    "Motion",
    "Observer",
    "Parameter",
    "Policy",
    "RobotFile",
    "RobotJoint",
    "Robots",
    "RobotsState",
    "Simulator",
    "Stopped",
    "Term",
    "Terms",
    "Training",
    "TrainingRobots",
    "ValidationResult",
    "__version__",
    "callbacks",
    "collect",
    "compare",
    "config",
    "costs",
    "evaluate",
    "explain",
    "finetune",
    "fit",
    "fit_simulator",
    "fleet",
    "load",
    "load_policy",
    "loop",
    "read_log",
    "read_robot",
    "results",
    "train",
    "validate",
]

#: Where what needs NumPy is: it is imported when it is asked for, so that the program starts without.
_PARTS = {
    "_cma": ("CMA",),
    "_fleet": ("fleet",),
    "_log_files": ("read_log",),
    "_logs": ("Finding", "Log"),
    "_observer": ("Observer",),
    "_own_simulator": ("FitOutcome", "Parameter", "Simulator", "fit_simulator"),
    "_policy": ("Interface", "Policy", "Term"),
    "_policy_file": ("LoadedPolicy", "load_policy"),
    "_progress": ("Event",),
    "_robot_file": ("RobotFile", "RobotJoint", "read_robot"),
    "_robots": ("Robots",),
    "_robots_state": ("Motion", "RobotsState"),
    "_stages": ("compare", "explain", "fit", "loop", "validate"),
    "_terms": ("Terms",),
    "_training_terms": ("TrainingRobots",),
    "_walks": ("collect", "evaluate", "finetune", "train"),
    "callbacks": ("callbacks",),
    "config": ("config",),
    "costs": ("costs",),
    # These need other packages, and say so.
    **{name: (name,) for name in ("gym", "mujoco", "mujoco_warp", "plots", "ray", "rsl_rl", "sb3")},
    "results": (
        "results",
        "Collection",
        "Evaluation",
        "FitResult",
        "FittedParameter",
        "Fleet",
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
