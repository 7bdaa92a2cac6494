"""Logs as objects: from arrays and tables, cut, checked, written, and fitted."""

import unittest

import numpy as np

import gaitfit
from gaitfit import Log

from .common import DEMO, Case


class Logs(Case):
    def setUp(self) -> None:
        super().setUp()
        self.log = gaitfit.read_log(DEMO / "fit.csv")

    def test_logs_are_equal_if_their_numbers_are(self) -> None:
        self.assertEqual(self.log, gaitfit.read_log(DEMO / "fit.csv"))
        self.assertNotEqual(self.log, self.log[1:])
        self.assertNotEqual(self.log, 3)
        broken = self.log.position.copy()
        broken[3, 4] = np.nan
        one, other = (Log(broken.copy(), self.log.velocity) for _ in range(2))
        self.assertEqual(one, other)
        self.assertIn("1800 samples, 12 joints, dt=0.005, position, velocity, target", repr(self.log))

    def test_all_parts_of_a_log_are_kept(self) -> None:
        walk = Log.from_arrays(
            joints=["knee", "wheel"], dt=0.02, position=np.zeros((3, 2)), velocity=np.zeros((3, 2)), target=np.ones((3, 2)),
            motion=[[0.0, 0.5], [0.02, 0.5], [0.04, 0.5]], target_lead=(0.004, 0.001), velocity_joints=["wheel"],
            simulated_step=0.005, fell=True,
        )  # fmt: skip
        walk.write(self.folder / "walk.csv")
        read = gaitfit.read_log(self.folder / "walk.csv")
        self.assertEqual((read.target_lead, read.velocity_joints), ((0.004, 0.001), ("wheel",)))
        self.assertEqual((read.simulated_step, read.fell), (0.005, True))
        np.testing.assert_array_equal(read.motion, walk.motion)
        self.assertEqual(read, walk)
        self.assertEqual((read[1:].target_lead, read[1:].motion[0, 0]), ((0.004, 0.001), 0.02))
        more = {"simulated_step": read.simulated_step, "fell": True}
        table = Log.from_dataframe(read.columns(), target_lead=read.target_lead, velocity_joints=read.velocity_joints, **more)
        self.assertEqual(table, read)
        with self.assertRaisesRegex(ValueError, "target_lead has 1 numbers"):
            Log.from_arrays(joints=["a"], dt=0.1, position=[[0.0]], velocity=[[0.0]], target_lead=(0.004,))  # type: ignore[arg-type]

    def test_arrays_tables_and_files_are_the_same_log(self) -> None:
        log = self.log
        arrays = Log.from_arrays(
            joints=log.joints, position=log.position, velocity=log.velocity, target=log.target, time=log.time, kp=log.kp, kd=log.kd
        )
        self.assertEqual((arrays.dt, len(arrays)), (log.dt, 1800))
        log.write(self.folder / "log.csv")
        self.assertEqual(gaitfit.read_log(self.folder / "log.csv"), log)
        table = Log.from_dataframe(log.columns(), kp=log.kp, kd=log.kd, dt=log.dt, robot=log.robot)
        self.assertEqual(table, log)
        try:
            import pandas  # noqa: F401
        except ImportError:
            self.skipTest("pandas is not installed")
        self.assertEqual(Log.from_dataframe(log.to_dataframe(), kp=log.kp, kd=log.kd, dt=log.dt, robot=log.robot), log)

    def test_the_inertial_unit_stays_with_its_log(self) -> None:
        written = gaitfit.collect(
            "assets/go2-walk.safetensors", self.folder / "logs", trajectories=1, seconds=1.0, progress=False
        )
        log = gaitfit.read_log(written.files[0])
        self.assertEqual((log.base_angular_velocity.shape, log.base_quaternion.shape), ((50, 3), (50, 4)))
        log.write(self.folder / "again.csv")
        self.assertEqual(gaitfit.read_log(self.folder / "again.csv"), log)
        self.assertEqual(log[10:20].base_quaternion.shape, (10, 4))
        self.assertIn("base_quat_w", log.columns())

    def test_logs_are_cut_by_time(self) -> None:
        cut = self.log.between(1.0, 2.0)
        self.assertEqual((cut.time[0], len(cut)), (1.0, 200))
        self.assertEqual((len(self.log.between(end=0.1)), len(self.log.between(8.0))), (20, 200))
        self.assertAlmostEqual(cut.duration, 0.995)
        with self.assertRaisesRegex(ValueError, "neither time nor dt"):
            Log(self.log.position, self.log.velocity).between(1.0)

    def test_findings_are_objects(self) -> None:
        self.assertEqual([one for one in self.log.check() if one.severity == "error"], [])
        broken = self.log.position.copy()
        broken[40:50, 2] = np.nan
        found = Log.from_arrays(
            joints=self.log.joints, time=self.log.time, position=broken, velocity=self.log.velocity, target=self.log.target
        ).check()
        worst = found[0]
        self.assertEqual((worst.severity, worst.kind), ("error", "not-finite"))
        self.assertEqual(worst.joints, (self.log.joints[2],))
        degrees = Log.from_arrays(
            joints=self.log.joints, time=self.log.time, position=np.degrees(self.log.position), velocity=self.log.velocity
        )
        self.assertIn("suspect-unit", [one.kind for one in degrees.check()])
        gap = self.log.time.copy()
        gap[900:] += 1.0
        late = Log.from_arrays(joints=self.log.joints, time=gap, position=self.log.position, velocity=self.log.velocity)
        span = next(one.samples for one in late.check() if one.kind == "time-gap")
        self.assertLessEqual(span.start, 900)
        self.assertGreaterEqual(span.stop, 900)

    def test_wrong_logs_are_named(self) -> None:
        q = np.zeros((4, 2))
        for call, error, words in (
            (lambda: Log(q, q[:3]), ValueError, r"velocity has the shape \(3, 2\); needed: samples × joints = \(4, 2\)"),
            (lambda: Log(q, q, command=q), ValueError, r"command has the shape \(4, 2\); needed: samples × 3 = \(4, 3\)"),
            (lambda: Log(q, q, time=[0.0]), ValueError, r"time has the shape \(1,\); needed: \(4,\)"),
            (lambda: Log(q, q, kp=[1.0, 2.0, 3.0]), ValueError, r"kp has the shape"),
            (lambda: Log(q, q, kp=20.0), ValueError, "kp is given without kd: give both gains"),
            (lambda: Log(q, q, kd=[1.0, 2.0]), ValueError, "kd is given without kp"),
            (lambda: Log(q, q, joints=["a"]), ValueError, "joints has 1 names, and position has 2 columns"),
            (lambda: Log(q, q, joints="ab"), TypeError, "joints is 'ab'"),
            (lambda: Log(q, q, dt=0.0), ValueError, "dt is 0.0; it must be above 0"),
            (lambda: Log("x", q), TypeError, "position: texts stand where"),
            (lambda: Log(q, q).check(), ValueError, "does not name its joints"),
            (lambda: Log(q, q, joints=["a", "b"]).check(), ValueError, "neither time nor dt"),
            (lambda: Log.from_arrays(joints=["a", "b"], position=q, velocity=q), ValueError, "neither dt nor time is given"),
            (lambda: Log.from_dataframe({"a": [1.0]}), ValueError, "no column q_J, a joint's position; it has a"),
            (lambda: Log.from_dataframe({"q_a": [1.0]}), ValueError, "no column dq_a"),
            (
                lambda: Log.from_dataframe({"time": [0.0], "q_a": [1.0], "dq_a": [1.0], "wx": [0.0]}),
                ValueError,
                "no column wy; a log needs it beside wx",
            ),
            (lambda: Log.from_dataframe(3), ValueError, "it has no columns"),
            (lambda: gaitfit.fit(logs=[3], progress=False), TypeError, "an element of logs is 3; .*a gaitfit.Log or a DataFrame"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                call()

    def test_logs_are_fitted_as_their_files_are(self) -> None:
        settings = {"optimizer.generations": 4, "optimizer.seeds": 1}
        given = {"runs": self.folder, "progress": False, "settings": settings}
        config = DEMO / "adapt.toml"
        from_file = gaitfit.fit(config, logs=DEMO / "fit.csv", name="file", **given)
        from_log = gaitfit.fit(config, logs=self.log, name="log", **given)
        self.assertEqual(from_log.parameters, from_file.parameters)
        again = gaitfit.fit(config, logs=[self.log], name="log", resume=True, **given)
        self.assertEqual((again.parameters, again.run_folder), (from_log.parameters, from_log.run_folder))
        self.assertEqual(len(list((self.folder / "python-logs").iterdir())), 1)

    def test_a_table_without_gains_is_told_how_it_gets_them(self) -> None:
        try:
            table = self.log.to_dataframe()
        except ImportError:
            self.skipTest("pandas is not installed")
        with self.assertRaisesRegex(gaitfit.GaitfitError, r"`Log\.from_dataframe\(table, kp="):
            gaitfit.fit(DEMO / "adapt.toml", logs=[table], runs=self.folder, progress=False)


if __name__ == "__main__":
    unittest.main()
