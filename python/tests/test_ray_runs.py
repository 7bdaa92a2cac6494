"""Fleets, tables and trainings on a Ray cluster of three nodes."""

import json
import os
import threading
import time
import unittest
from pathlib import Path

import gaitfit
from gaitfit._given import sets

from .common import DEMO
from .test_own_policy import FILE
from .test_ray_fits import Ray, found


class Fleets(Ray):
    def test_the_fits_of_a_fleet_are_those_of_one_machine(self) -> None:
        import gaitfit.ray

        log = gaitfit.read_log(DEMO / "fit.csv")
        robots = {f"robot-{at}": log.between(at, at + 1.0) for at in range(4)}
        settings = {"optimizer.method": "least-squares", "optimizer.seeds": 1, "simulation.timestep": 0.005}
        arguments = {"settings": settings, "progress": False}
        fleet = gaitfit.ray.fleet(robots, DEMO / "adapt.toml", runs=self.folder, **arguments)
        alone = {
            name: gaitfit.fit(DEMO / "adapt.toml", logs=one, name=name, runs=self.folder / "alone", **arguments)
            for name, one in robots.items()
        }
        for name, one in alone.items():
            worker = gaitfit.load(self.folder / "fleet" / name)
            self.assertEqual(found(worker), found(one))
            self.assertEqual(worker.run_folder.resolve(), (self.folder / "fleet" / name).resolve())
        same = gaitfit.fleet(alone)
        self.assertEqual((fleet.numbers, fleet.robots), (same.numbers, same.robots))
        self.assertEqual(gaitfit.load(self.folder / "fleet" / "fleet.json"), fleet)
        parted = {name: [one.between(at, at + 0.5), one.between(at + 0.5, at + 1.0)] for at, (name, one) in enumerate(robots.items())}
        twice = gaitfit.ray.fleet(parted, DEMO / "adapt.toml", runs=self.folder, name="twice", fits=2, **arguments)
        self.assertEqual(twice.document["folders"]["robot-3"][1], os.path.relpath(self.folder / "twice" / "robot-3-2"))
        self.assertNotEqual({one.calibration for one in twice.numbers.values()}, {1.0})
        again = gaitfit.ray.fleet(robots, DEMO / "adapt.toml", runs=self.folder, resume=True, **arguments)
        self.assertEqual(again.robots, fleet.robots)
        with self.assertRaisesRegex(FileNotFoundError, "nowhere"):
            gaitfit.ray.fleet({**robots, "robot-1": "nowhere.csv"}, DEMO / "adapt.toml", runs=self.folder, **arguments)

    def test_wrong_fleets_are_refused(self) -> None:
        import gaitfit.ray

        with self.assertRaisesRegex(ValueError, "there are 3 robots"):
            gaitfit.ray.fleet({"a": "a.csv", "b": "b.csv", "c": "c.csv"})
        with self.assertRaisesRegex(ValueError, "must be a name for a folder"):
            gaitfit.ray.fleet({"a/b": "a.csv", "b": "b.csv", "c": "c.csv", "d": "d.csv"})
        with self.assertRaisesRegex(TypeError, "robots is 3"):
            gaitfit.ray.fleet(3)
        with self.assertRaisesRegex(ValueError, "the robot a has 1 logs, and fits is 2"):
            gaitfit.ray.fleet({"a": "a.csv", "b": "b.csv", "c": "c.csv", "d": "d.csv"}, fits=2)


class Tables(Ray):
    SMALL = {
        "target.trajectories": 8,
        "target.seconds": 2.0,
        "adapt.optimizer.generations": 4,
        "adapt.optimizer.population": 4,
        "adapt.simulation.skip_seconds": 0.2,
    }

    def table(self, **more: object) -> dict:
        import gaitfit.ray

        arguments = {"only": "*-matchs*", "seeds": 2, "settings": self.SMALL, "runs": self.folder, "progress": False, **more}
        return gaitfit.ray.reproduce("parameters", **arguments).to_dict()

    def alone(self) -> dict:
        request = {
            "table": "parameters",
            "full": False,
            "seeds": 2,
            "only": "*-matchs*",
            "sets": sets({**self.SMALL, "runs": str(self.folder / "alone")}),
            "experiments": "experiments",
            "threads": None,
            "device": "cpu",
        }
        return json.loads(gaitfit._gaitfit.reproduce(request, None))

    def numbers(self, results: dict) -> object:
        return [
            [row["cell"], row["cost_value"], row["errors_percent"], [seed["fit"]["values"] for seed in row["seeds"]]]
            for row in results["rows"]
        ]

    def test_a_table_is_the_programs_and_a_lost_cell_goes_on(self) -> None:
        lost = []

        def remove() -> None:
            self.cluster.remove_node(self.nodes.pop(), allow_graceful=False)

        notes = []

        def progress(event: gaitfit.Event) -> None:
            if event.kind == "begin" and event.total == 4 and not lost:
                # In the midst of the first cells.
                lost.append(threading.Timer(1.0, remove))
                lost[0].start()
            if event.kind == "note":
                notes.append(event.text)

        shared = self.table(progress=progress, every=0.3)
        lost[0].join()
        self.assertTrue(any("its worker was lost" in note for note in notes), notes)
        self.nodes.append(self.add())
        self.assertEqual(self.numbers(shared), self.numbers(self.alone()))
        cell = self.folder / "reproduce-parameters" / "cells" / "model-shift-fricarm-matchs1" / "seed-2"
        seed = json.loads((cell / "seed.json").read_text())
        self.assertEqual(Path(seed["run_folder"]).resolve(), cell.resolve())
        self.assertTrue((cell / "round-1" / "adapt" / "report.html").exists())
        begun = time.monotonic()
        self.assertEqual(self.numbers(self.table()), self.numbers(shared))
        print(f"a finished table again: {time.monotonic() - begun:.1f} s")


class Trainings(Ray):
    def test_seeds_are_those_of_one_machine(self) -> None:
        import gaitfit.ray

        settings = {"train.num_envs": 64, "train.iterations": 3}
        arguments = {"seeds": [1, 2], "settings": settings, "runs": self.folder, "progress": False}
        alone = gaitfit.train(name="alone", **arguments).to_dict()
        shared = gaitfit.ray.train(name="shared", **arguments).to_dict()
        for seed in (1, 2):
            policies = [(self.folder / name / f"seed-{seed}" / "policy.safetensors").read_bytes() for name in ("alone", "shared")]
            self.assertEqual(*policies)
        self.assertEqual(len(shared["seeds"]), len(alone["seeds"]))
        again = gaitfit.ray.train(name="shared", resume=True, **arguments).to_dict()
        self.assertEqual(again["seeds"], shared["seeds"])

    def test_fine_tunings_are_those_of_one_machine(self) -> None:
        import gaitfit.ray

        settings = {"train.num_envs": 64, "train.iterations": 3}
        arguments = {"seeds": [1, 2], "settings": settings, "runs": self.folder, "progress": False}
        gaitfit.finetune(FILE, name="alone", **arguments)
        shared = gaitfit.ray.finetune(FILE, name="shared", **arguments).to_dict()
        for seed in (1, 2):
            policies = [(self.folder / name / f"seed-{seed}" / "policy.safetensors").read_bytes() for name in ("alone", "shared")]
            self.assertEqual(*policies)
        self.assertEqual(gaitfit.ray.finetune(FILE, name="shared", resume=True, **arguments).to_dict()["seeds"], shared["seeds"])


class Limits(Ray):
    SETTINGS = {"optimizer.method": "least-squares", "optimizer.seeds": 1, "simulation.timestep": 0.005}

    def test_a_fit_returns_what_it_has(self) -> None:
        import gaitfit.ray

        long = {"optimizer.seeds": 1, "optimizer.generations": 2000, "optimizer.tolerance": 1e-300}
        cut = self.fit(gaitfit.ray.fit, "cut", long, max_seconds=2.0)
        self.assertFalse(cut.converged)
        self.assertLess(len(cut.history()), 2000)
        self.assertIsNotNone(cut.sharing)

    def test_a_fleet_stops_and_continues(self) -> None:
        import gaitfit.ray

        log = gaitfit.read_log(DEMO / "fit.csv")
        arguments = {
            "robots": {f"robot-{at}": log.between(at, at + 1.0) for at in range(4)}, "config": DEMO / "adapt.toml",
            "settings": self.SETTINGS, "runs": self.folder, "progress": False,
        }
        with self.assertRaisesRegex(gaitfit.Stopped, r"stopped after 0.001 s \(max_seconds\).*resume=True") as stopped:
            gaitfit.ray.fleet(**arguments, max_seconds=1e-3)
        self.assertEqual(stopped.exception.run_folder.resolve(), (self.folder / "fleet").resolve())
        self.assertEqual(len(gaitfit.ray.fleet(**arguments, max_seconds=600.0, resume=True).robots), 4)
        with self.assertRaisesRegex(ValueError, "max_seconds is 0"):
            gaitfit.ray.fleet(**arguments, max_seconds=0.0)

    def test_a_training_keeps_what_workers_sent(self) -> None:
        import gaitfit.ray

        arguments = {"seeds": [1, 2], "settings": {"train.num_envs": 32, "train.iterations": 2000}, "every": 0.3}
        with self.assertRaisesRegex(gaitfit.Stopped, "max_seconds") as stopped:
            gaitfit.ray.train(**arguments, runs=self.folder, max_seconds=20.0, progress=False)
        self.assertTrue((stopped.exception.run_folder / "seed-1" / "metrics.jsonl").exists())

    def test_a_progress_function_stops_a_fleet(self) -> None:
        import gaitfit.ray

        log = gaitfit.read_log(DEMO / "fit.csv")
        robots = {f"robot-{at}": log.between(at, at + 1.0) for at in range(4)}
        with self.assertRaisesRegex(gaitfit.Stopped, "progress function returned False") as stopped:
            gaitfit.ray.fleet(
                robots, DEMO / "adapt.toml", settings=self.SETTINGS, runs=self.folder, progress=lambda event: event.kind != "step"
            )
        self.assertEqual(len(list(stopped.exception.run_folder.glob("*/result.json"))), 1)


if __name__ == "__main__":
    unittest.main()
