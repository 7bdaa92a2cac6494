"""Results: typed fields, tables, JSON, equality, and reading them again."""

import copy
import json
import pickle
import unittest
from dataclasses import FrozenInstanceError
from pathlib import Path
from unittest import mock

import gaitfit
from gaitfit.results import Named
from gaitfit.results._read import loop_result, table_result

from .common import DEMO, Case

POLICY = "assets/go2-walk.safetensors"


class Fits(Case):
    def setUp(self) -> None:
        super().setUp()
        settings = {"optimizer.generations": 8, "optimizer.seeds": 2}
        self.found = gaitfit.fit(DEMO / "adapt.toml", runs=self.folder, settings=settings, progress=False, name="fit")

    def test_fields_have_the_documents_values(self) -> None:
        found = self.found
        document = found.to_dict()
        self.assertEqual(list(found.parameters), [one["name"] for one in document["parameters"]])
        delay, row = found.parameters["delay"], document["parameters"][-1]
        self.assertEqual((delay.name, delay.value, delay.unit), ("delay", row["value"], "s"))
        self.assertEqual(delay.interval, tuple(row["interval"]) if row["interval"] else None)
        self.assertEqual((delay.truth, delay.lower, delay.upper), (row["truth"], row["lower"], row["upper"]))
        self.assertIn(found.standing, ("sound", "doubtful"))
        self.assertEqual(found.doubts[0].kind, document["doubts"][0]["kind"])
        self.assertEqual((found.run_folder, found.theta.is_file()), (self.folder / "fit", True))
        self.assertEqual(found.validation[0].rmse_per_joint["FL_hip"], document["validation"][0]["rmse_per_joint"]["FL_hip"])
        self.assertEqual(found.fits[0].parameters, found.parameters)
        self.assertEqual(found.report, self.folder / "fit" / "report.html")
        self.assertIn(found.headline, repr(found))

    def test_what_is_absent_is_named(self) -> None:
        with self.assertRaisesRegex(KeyError, "no 'delays'; there are frictionloss_hip"):
            self.found.parameters["delays"]
        with self.assertRaises(AttributeError):
            self.found.heedline  # type: ignore[attr-defined]  # noqa: B018
        with self.assertRaises(FrozenInstanceError):
            self.found.cost = 0.0  # type: ignore[misc]

    def test_they_are_plain_data_tables_and_equal_to_copies(self) -> None:
        found = self.found
        self.assertEqual(json.loads(found.to_json()), found.to_dict())
        self.assertEqual(pickle.loads(pickle.dumps(found)), found)
        self.assertEqual(copy.deepcopy(found), found)
        rows = found.rows()
        self.assertEqual((len(rows), rows[0]["name"]), (10, "frictionloss_hip"))
        delay = found.parameters["delay"]
        self.assertEqual((rows[-1]["interval_lower"], rows[-1]["interval_upper"]), delay.interval or (None, None))
        self.assertEqual([key for row in rows for key, value in row.items() if isinstance(value, (list, dict, tuple))], [])
        try:
            import pandas  # noqa: F401
        except ImportError:
            self.skipTest("pandas is not installed")
        table = found.to_dataframe().set_index("name")
        self.assertEqual(table.loc["delay", "value"], found.parameters["delay"].value)
        with mock.patch.dict("sys.modules", {"pandas": None}), self.assertRaisesRegex(ImportError, "pip install pandas"):
            found.to_dataframe()

    def test_a_run_folder_is_read_again(self) -> None:
        loaded = gaitfit.load(self.found.run_folder)
        self.assertIsInstance(loaded, gaitfit.FitResult)
        self.assertEqual(loaded, self.found)
        printed = self.folder / "printed.json"
        printed.write_text(self.found.to_json(indent=2), encoding="utf-8")
        self.assertEqual(gaitfit.load(printed), self.found)
        checked = gaitfit.validate(self.found.theta, DEMO / "validate.csv")
        self.assertGreater(checked.rmse_rad or 0.0, 0.0)
        printed.write_text(checked.to_json(), encoding="utf-8")
        self.assertEqual(gaitfit.load(printed), checked)
        self.assertEqual(checked.to_dict()["validation"][0]["file"], checked.validation[0].file)


class Others(Case):
    def test_wrong_files_are_named(self) -> None:
        with self.assertRaisesRegex(FileNotFoundError, "there is no nowhere"):
            gaitfit.load("nowhere")
        with self.assertRaisesRegex(FileNotFoundError, "no result.json: it is no run folder, or its run has not ended"):
            gaitfit.load(self.folder)
        file = self.folder / "a.json"
        for text, words in (
            ("{", "is no JSON"),
            ("3", "is no result of gaitfit"),
            ('{"a": 1}', "is no result of gaitfit: it has a"),
            ('{"fits": []}', "needs 'name'"),
            ('{"fits": 3, "results": {"seeds": [{"seed": 1}]}}', "is no result of gaitfit"),
        ):
            file.write_text(text, encoding="utf-8")
            with self.subTest(text), self.assertRaisesRegex(ValueError, words):
                gaitfit.load(file)

    def test_an_evaluation_and_a_training(self) -> None:
        walked = gaitfit.evaluate(POLICY, trajectories=8, seconds=0.5, drift=1, progress=False)
        document = walked.to_dict()
        self.assertEqual(walked.fall_rate.mean, document["fall_rate"]["mean"])
        self.assertEqual(walked.drift[0].path[-1], tuple(document["drift"][0]["path"][-1]))
        self.assertEqual(walked.rows()[0]["quantity"], "linear_velocity_error")
        size = {"train.num_envs": 32, "train.iterations": 2}
        trained = gaitfit.train(runs=self.folder, name="t", settings=size, progress=False)
        self.assertEqual((trained.seeds[0].iterations, trained.policy.is_file()), (2, True))
        self.assertEqual(gaitfit.load(trained.run_folder), trained)
        self.assertEqual([row["seed"] for row in trained.rows()], [1])
        self.assertRegex(repr(trained), r"^Training\(t: 2 iterations, velocity error \d\.\d\d m/s")

    def test_a_loop_and_a_table_of_plain_data(self) -> None:
        """Documents as the program writes them, with the parts of real ones."""
        walked = gaitfit.evaluate(POLICY, trajectories=4, seconds=0.5, drift=0, progress=False).to_dict()
        document = {
            **{key: "text" for key in ("name", "robot", "before", "after", "policy", "onnx", "stopped_because", "run_folder")},
            **{"target": None, "rounds": [], "comparisons": [], "doubts": [], "warnings": ["late"], "wall_seconds": 1.0},
            "evaluations": [{**walked, "on": "target", "policy": "π₀"}],
            "stage_seconds": {"collect": 0.5},
        }
        loop = loop_result(document)
        self.assertEqual((loop.policy, loop.stage_seconds["collect"]), (Path("text"), 0.5))
        self.assertEqual(loop.measured("π₀", "target").fall_rate.mean, walked["fall_rate"]["mean"])
        with self.assertRaisesRegex(KeyError, "π₁ was not measured on target; there are π₀ on target"):
            loop.measured("π₁", "target")
        row = {"cell": "a", "scenario": "b", "seconds": 1.0, "errors_percent": {"delay": {"mean": 2.0, "ci95": None}}}
        table = table_result({"table": "t", "title": "T", "full": False, "rows": [row], "run_folder": "runs/t"})
        self.assertEqual(table.cells[0].errors_percent["delay"].mean, 2.0)
        self.assertEqual(table.rows()[0]["errors_percent.delay.mean"], 2.0)
        self.assertEqual(table_result(table.to_dict()), table)

    def test_names_are_a_dict(self) -> None:
        self.assertEqual(Named({"a": 1}), {"a": 1})
        self.assertEqual(pickle.loads(pickle.dumps(Named({"a": 1}))), {"a": 1})


if __name__ == "__main__":
    unittest.main()
