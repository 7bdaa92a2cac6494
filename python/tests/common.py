"""What the tests share."""

from __future__ import annotations

import os
import tempfile
import unittest
from pathlib import Path
from typing import Any

import numpy as np

import gaitfit

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGE = ROOT / "python"
DEMO = ROOT / "examples" / "go2-demo"
PROGRAM = Path(os.environ.get("GAITFIT_PROGRAM", ROOT / "target" / "debug" / "gaitfit"))


class Case(unittest.TestCase):
    """A test at the repository's root, where the examples' paths begin, with a folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(ROOT)


class GpuCase(Case):
    """A test that needs a GPU and PyTorch that uses it: ``self.torch``, and 4 ``self.robots``."""

    def setUp(self) -> None:
        super().setUp()
        try:
            import torch
        except ImportError as missing:
            self.skipTest(str(missing))
        if not torch.cuda.is_available():
            self.skipTest("PyTorch sees no GPU here")
        try:
            self.robots = gaitfit.Robots(num_envs=4, device="cuda")
        except gaitfit.GaitfitError as missing:
            self.skipTest(str(missing))
        self.torch = torch

    def actions(self, count: int, steps: int) -> Any:
        rng = np.random.default_rng(3)
        return rng.normal(0.0, 0.3, size=(steps, count, 12)).astype(np.float32)
