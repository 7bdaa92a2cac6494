"""What the tests share."""

from __future__ import annotations

import os
import tempfile
import unittest
from pathlib import Path

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
