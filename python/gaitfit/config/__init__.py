"""Settings as dataclasses, made from the program's own: autocompletion, types, and documentation with units.

>>> from gaitfit.config import Fit, Optimizer, Parameter
>>> config = Fit(
...     robot="assets/go2.xml",
...     logs=["examples/go2-demo/fit.csv"],
...     parameters=[Parameter("frictionloss", per="group", upper=1.0), Parameter("delay", per="all")],
...     optimizer=Optimizer(generations=50),
... )
>>> print(config.to_toml())
robot = "assets/go2.xml"
logs = ["examples/go2-demo/fit.csv"]
<BLANKLINE>
[optimizer]
generations = 50
<BLANKLINE>
[[parameter]]
kind = "frictionloss"
per = "group"
upper = 1.0
<BLANKLINE>
[[parameter]]
kind = "delay"
per = "all"
<BLANKLINE>
>>> Fit.from_toml(config.to_toml()) == config
True

:func:`gaitfit.fit` and :func:`gaitfit.validate` take a :class:`Fit` as ``config=``, :func:`gaitfit.train` and robots a
:class:`Train`, :func:`gaitfit.finetune` a :class:`Finetune`, :func:`gaitfit.evaluate` an :class:`Evaluate`, :func:`gaitfit.collect` a
:class:`Collect` and :func:`gaitfit.loop` a :class:`Loop`. The other functions have arguments alone. A setting that is ``None`` has
gaitfit's default, which may depend on other settings.

Counts of robots have one word each. ``num_envs``: robots that are stepped together, in trainings and in :class:`gaitfit.Robots`.
``trajectories``: robots of an evaluation or a collection, each of which walks once under random commands; ``drift``: robots of
each trial with a constant command. ``population``: candidates of a generation of a fit, each simulated from ``starts`` starts
under every log. Simulated robots are those whose logs correct a fit; their number follows from ``replicates``.
"""

from .._settings import Settings, helpful
from ._fit import (
    Check,
    Cost,
    Falls,
    Fit,
    Gains,
    Network,
    Number,
    Optimizer,
    Parameter,
    Prior,
    Simulation,
    ValidateGains,
)
from ._loop import Collect, Controls, Evaluate, Loop, Target, TrueNumber, TrueParameter, Truth
from ._task import (
    Command,
    Curriculum,
    Fall,
    History,
    Push,
    Randomisation,
    Start,
    Task,
    TaskPolicy,
    Term,
    Terrain,
)
from ._train import Finetune, Memory, Ppo, Size, Train

__all__ = [
    "Check",
    "Collect",
    "Command",
    "Controls",
    "Cost",
    "Curriculum",
    "Evaluate",
    "Fall",
    "Falls",
    "Finetune",
    "Fit",
    "Gains",
    "History",
    "Loop",
    "Memory",
    "Network",
    "Number",
    "Optimizer",
    "Parameter",
    "Ppo",
    "Prior",
    "Push",
    "Randomisation",
    "Settings",
    "Simulation",
    "Size",
    "Start",
    "Target",
    "Task",
    "TaskPolicy",
    "Term",
    "Terrain",
    "Train",
    "TrueNumber",
    "TrueParameter",
    "Truth",
    "ValidateGains",
]

for _one in list(globals().values()):
    if isinstance(_one, type) and issubclass(_one, Settings):
        helpful(_one)
