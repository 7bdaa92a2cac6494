"""Fits, tables and trainings on many machines, by Ray (``pip install "gaitfit[ray]"``).

Results have the bits of one machine, whatever the number of workers and whichever of them are lost on the way.
``address`` is as :func:`ray.init` takes it; without one the running cluster is used, or one on this machine begins.
"""

from ._fit import fit
from ._fleet import fleet
from ._tables import reproduce
from ._train import finetune, train

__all__ = ["finetune", "fit", "fleet", "reproduce", "train"]
