"""Ray: the bits of one machine on a cluster of three nodes, whoever is lost on the way."""

import importlib.util
import json
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np

import gaitfit
from gaitfit import Policy
from gaitfit._given import fit_settings, run as run_of, sets
from gaitfit.config import Fit
from gaitfit.results._read import fit_result

from .common import DEMO, PACKAGE, ROOT, Case
from .test_own_policy import FILE, LAYERS, network

RAY = importlib.util.find_spec("ray") is not None
#: One number instead of the dozens of a walk's fit: a policy that is a function is slow.
ONE = {"parameter": [{"kind": "frictionloss", "per": "all", "upper": 0.8}]}
SETTINGS = {"optimizer.generations": 10, "optimizer.seeds": 2, "costs": ["matcho", "wass"], "checkpoint_seconds": 0.0}


def found(results: gaitfit.FitResult) -> object:
    """What a fit found, without times and places."""
    document = results.to_dict()
    return [document["parameters"], document["cost"], [[fit["cost"], fit["parameters"]] for fit in document["fits"]]]


class OwnCrew:
    """Workers in this process, who answer in another order than they were asked in."""

    def __init__(self, places: int, alike: bool) -> None:
        self._places, self.alike, self.done = places, alike, 0

    policy = None

    def open(self, parcel: bytes, mark: str) -> None:
        self.helper, self.mark = gaitfit._gaitfit.Helper(parcel, 1, "cpu", self.policy), mark

    def places(self) -> int:
        return self._places

    def work(self, tasks: list[bytes]) -> object:
        for number in reversed(range(len(tasks))):
            yield None
            yield number, self.helper.work(tasks[number])
            self.done += 1


class Shared(Case):
    """What is shared, without Ray: the same bits however candidates are cut."""

    def fit(self, config: object, crew: object, **more: object) -> gaitfit.FitResult:
        given = {name: more.pop(name, None) for name in ("logs", "robot", "policy", "costs")}
        settings = fit_settings(*given.values(), more.pop("settings"), self.folder)
        run = run_of(config, Fit, settings, "own", False, None, "cpu")
        return fit_result(json.loads(gaitfit._gaitfit.adapt(run, None, None, crew)))

    def test_a_fit_has_the_same_bits_however_it_is_cut(self) -> None:
        alone = self.fit(DEMO / "adapt.toml", None, settings=SETTINGS)
        for places, alike in ((1, True), (2, False), (64, True)):
            crew = OwnCrew(places, alike)
            shared = self.fit(DEMO / "adapt.toml", crew, settings=SETTINGS)
            self.assertEqual(found(shared), found(alone))
            self.assertEqual(crew.helper.mark, crew.mark)
            self.assertGreater(crew.done, 10)
        with self.assertRaisesRegex(TypeError, "cannot be pickled"):
            pickle.dumps(crew.helper)
        for wrong in (b"", b"{}", b'{"simulator":9,"values":"None","work":{"Costs":[]}}', b'{"simulator":0,"values":"None","work":{"Costs":[{"cost":7,"values":[],"draw":0}]}}'):
            with self.assertRaises(gaitfit.GaitfitError):
                crew.helper.work(wrong)

    def test_walking_logs_corrections_and_odd_joints_have_the_same_bits(self) -> None:
        policy, logs = ROOT / "assets" / "go2-walk.safetensors", self.folder / "logs"
        gaitfit.collect(policy, logs, trajectories=8, seconds=2.5, privileged=True, torque_noise=1.0, progress=False)
        short = {"optimizer.seeds": 1, "optimizer.generations": 2}
        for settings, tasks in (
            # Least squares, its correction by simulated logs and its intervals.
            ({"costs": ["matchr1"], "optimizer.replicates": 1, **short}, 11),
            ({"costs": ["matchr1"], "optimizer.replicates": 0, "odd_joints": True, **short}, 11),
            # The robots that correct `wass` are simulated by the driver.
            ({"costs": ["wass"], **short}, 10),
        ):
            with self.subTest(settings=settings):
                crew = OwnCrew(3, True)
                both = [self.fit(None, one, logs=logs, policy=policy, settings=settings) for one in (None, crew)]
                self.assertEqual(found(both[1]), found(both[0]))
                kept = [one.to_dict() for one in both]
                self.assertEqual(kept[1]["fits"], kept[0]["fits"])
                self.assertGreaterEqual(crew.done, tasks)

    def test_what_the_driver_computes_alone_is_listed(self) -> None:
        from gaitfit.ray._fit import Crew

        crew = Crew(SimpleNamespace(place=SimpleNamespace(num_gpus=0)))
        derivatives, robots = "derivatives of logs of clamped legs", "simulated robots that correct wass"
        for base, method, preset, cost, listed in (
            ("fixed", "least-squares", "accurate", "matcho", {derivatives}),
            ("fixed", "least-squares", "converged", "matcho", set()),
            ("fixed", "least-squares", "accurate", "matchr1", set()),
            ("fixed", "cma-es", "accurate", "matcho", set()),
            ("free", "least-squares", "accurate", "matcho", set()),
            ("free", "auto", "accurate", "wass", {robots}),
            ("fixed", "auto", "accurate", "wass", set()),
        ):
            with self.subTest(base=base, method=method, preset=preset, cost=cost):
                (self.folder / "config.toml").write_text(
                    f'base = "{base}"\n[optimizer]\nmethod = "{method}"\n[simulation]\npreset = "{preset}"\n', encoding="utf-8"
                )
                fits = [SimpleNamespace(cost_name=cost)]
                sharing = crew.sharing(1.0, SimpleNamespace(run_folder=self.folder, validation=(), held_out=None, fits=fits))
                self.assertEqual(set(sharing.alone), {"the search's own arithmetic", "the report"} | listed)

    def test_a_policy_that_is_a_function_acts_at_both_ends(self) -> None:
        logs = self.folder / "logs"
        settings = {**ONE, "optimizer.seeds": 1, "optimizer.generations": 2, "optimizer.population": 6}
        gaitfit.collect(FILE, logs, trajectories=10, seconds=2.5, progress=False)
        calls = []

        def there(observation: np.ndarray) -> np.ndarray:
            calls.append(len(observation))
            if len(calls) == 200:
                raise LookupError("the network is gone")
            return network(observation)

        def fit(crew: object) -> gaitfit.FitResult:
            given = fit_settings(logs, None, "the function network", "wass", settings, self.folder)
            run = run_of(None, Fit, given, "own", False, None, "cpu")
            return fit_result(json.loads(gaitfit._gaitfit.adapt(run, Policy(network, FILE).native(), None, crew)))

        alone = fit(None)
        crew = OwnCrew(3, True)
        crew.policy = Policy(network, FILE).native()
        self.assertEqual(found(fit(crew)), found(alone))
        self.assertGreater(crew.done, 3)
        crew.policy = Policy(there, FILE).native()
        with self.assertRaisesRegex(LookupError, "the network is gone"):
            fit(crew)
        crew.policy = None
        with self.assertRaisesRegex(gaitfit.GaitfitError, "the function network"):
            fit(crew)

    def test_what_a_crew_raises_comes_back(self) -> None:
        class Broken(OwnCrew):
            def work(self, tasks: list[bytes]) -> object:
                yield 0, self.helper.work(tasks[0])
                raise ZeroDivisionError("mine")

        class Idle(OwnCrew):
            def work(self, tasks: list[bytes]) -> object:
                yield 0, self.helper.work(tasks[0])

        for crew, error, words in (
            (Broken(4, True), ZeroDivisionError, "mine"),
            (Idle(4, True), gaitfit.GaitfitError, "left undone"),
            (object(), AttributeError, "open"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                self.fit(DEMO / "adapt.toml", crew, settings=SETTINGS)


class Absent(Case):
    def test_without_ray_the_message_has_the_command(self) -> None:
        import gaitfit.ray

        with mock.patch.dict(sys.modules, {"ray": None}):
            for call in (lambda: gaitfit.ray.fit(DEMO / "adapt.toml"), lambda: gaitfit.ray.reproduce("parameters")):
                with self.assertRaisesRegex(ImportError, r'pip install "gaitfit\[ray\]"'):
                    call()

    def test_wrong_arguments_are_told_before_anything_begins(self) -> None:
        import gaitfit.ray

        for arguments, words in (
            ({"num_cpus": -1}, "num_cpus is -1"),
            ({"num_cpus": float("nan")}, "num_cpus is nan"),
            ({"num_cpus": 0}, "both 0"),
            ({"retries": -2}, "retries is -2"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                gaitfit.ray.fit(DEMO / "adapt.toml", **arguments)
        with self.assertRaisesRegex(TypeError, "has no weights"):
            gaitfit.ray.finetune(Policy(network, FILE))
        for arguments, error, words in (
            ({"table": 3}, TypeError, "table is 3"),
            ({"seeds": 0}, ValueError, "seeds is 0"),
            ({"only": 3}, TypeError, "only is 3"),
            ({"settings": 3}, TypeError, "settings is 3"),
            ({"runs": 3}, TypeError, "runs is 3"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                gaitfit.ray.reproduce(**{"table": "parameters", **arguments})
        with self.assertRaisesRegex(ValueError, "is a function, which GPUs do not"):
            gaitfit.ray.fit(policy=Policy(network, FILE), num_gpus=1)


@unittest.skipUnless(RAY, "Ray is not installed: tools/setup_venv.sh --ray")
class Ray(Case):
    """A cluster of three nodes: the driver's own, without a place for tasks, and two with one each."""

    @classmethod
    def setUpClass(cls) -> None:
        import ray
        from ray.cluster_utils import Cluster

        paths = [str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])]
        os.environ["PYTHONPATH"] = os.pathsep.join(paths)
        os.environ["RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO"] = "0"
        cls.cluster = Cluster(
            initialize_head=True,
            head_node_args={
                "num_cpus": 0,
                "object_store_memory": 10**8,
                "include_dashboard": False,
                # A node that is gone is noticed within seconds.
                "_system_config": {"health_check_period_ms": 500, "health_check_failure_threshold": 4},
            },
        )
        cls.nodes = [cls.add() for _ in range(2)]
        ray.init(address=cls.cluster.address, logging_level="error", log_to_driver=False)
        cls.cluster.wait_for_nodes()

    @classmethod
    def add(cls) -> object:
        return cls.cluster.add_node(num_cpus=1, object_store_memory=10**8)

    @classmethod
    def tearDownClass(cls) -> None:
        import ray

        ray.shutdown()
        cls.cluster.shutdown()

    def fit(self, fit: object, name: str, settings: dict | None = None, **more: object) -> gaitfit.FitResult:
        settings = {**SETTINGS, **(settings or {})}
        return fit(DEMO / "adapt.toml", runs=self.folder, name=name, settings=settings, progress=False, **more)


class Fits(Ray):
    def test_a_fit_has_the_bits_of_one_machine(self) -> None:
        import gaitfit.ray

        alone = self.fit(gaitfit.fit, "alone")
        shared = self.fit(gaitfit.ray.fit, "shared")
        self.assertEqual(found(shared), found(alone))
        read = [(self.folder / name / "metrics.jsonl").read_text().splitlines() for name in ("alone", "shared")]
        for one, other in zip(*read, strict=True):
            one, other = json.loads(one), json.loads(other)
            self.assertEqual({**one, "wall_seconds": 0}, {**other, "wall_seconds": 0})
        self.assertIsNone(alone.sharing)
        sharing = shared.sharing
        assert sharing is not None
        # Ten generations of each seed and cost at least, by two workers.
        self.assertGreaterEqual(sharing.tasks["costs"], 10)
        self.assertGreaterEqual(sharing.tasks["intervals"], 2)
        self.assertEqual(len(sharing.workers), 2)
        self.assertTrue(all(seconds > 0 for seconds in sharing.workers.values()), sharing)
        self.assertIn("validation logs", sharing.alone)
        # A finished run is taken as it is, also by one machine.
        self.assertEqual(found(self.fit(gaitfit.fit, "shared", resume=True)), found(alone))

    def test_a_node_lost_in_a_generation_changes_nothing(self) -> None:
        import gaitfit.ray

        alone = self.fit(gaitfit.fit, "alone")
        lost = []

        def progress(event: gaitfit.Event) -> None:
            if event.kind == "step" and event.done == 4 and not lost:
                # In the midst of the next generation.
                lost.append(threading.Timer(0.02, lambda: self.cluster.remove_node(self.nodes.pop(), allow_graceful=False)))
                lost[0].start()

        shared = self.fit_with(progress)
        lost[0].join()
        self.assertEqual(len(self.nodes), 1)
        self.nodes.append(self.add())
        self.cluster.wait_for_nodes()
        self.assertEqual(found(shared), found(alone))

    def fit_with(self, progress: object) -> gaitfit.FitResult:
        import gaitfit.ray

        return gaitfit.ray.fit(DEMO / "adapt.toml", runs=self.folder, name="lost", settings=SETTINGS, progress=progress)

    def test_a_killed_driver_goes_on(self) -> None:
        import gaitfit.ray

        alone = self.fit(gaitfit.fit, "alone")
        code = (
            "import sys, json, gaitfit.ray\n"
            "arguments = json.loads(sys.argv[1])\n"
            "gaitfit.ray.fit(**arguments, progress=lambda event: print(event.kind, event.done, flush=True))\n"
        )
        arguments = {
            "config": str(DEMO / "adapt.toml"),
            "runs": str(self.folder),
            "name": "killed",
            "settings": SETTINGS,
            "address": self.cluster.address,
        }
        at = random.SystemRandom().randrange(1, 10)
        driver = subprocess.Popen(
            [sys.executable, "-c", code, json.dumps(arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        steps = 0
        for line in driver.stdout:
            steps += line.startswith("step")
            if steps == at:
                time.sleep(random.SystemRandom().uniform(0.0, 0.1))
                driver.send_signal(signal.SIGKILL)
                break
        errors = driver.communicate()[1]
        self.assertEqual(driver.returncode, -signal.SIGKILL, errors)
        self.assertFalse((self.folder / "killed" / "result.json").exists())
        resumed = self.fit(gaitfit.ray.fit, "killed", resume=True)
        self.assertEqual(found(resumed), found(alone), f"killed after generation {at}")

    def test_what_goes_wrong_is_told(self) -> None:
        import gaitfit.ray
        import ray

        with self.assertRaisesRegex(gaitfit.GaitfitError, "has 99 CPUs"):
            self.fit(gaitfit.ray.fit, "large", num_cpus=99)
        with self.assertRaisesRegex(FileNotFoundError, "nowhere.csv"):
            self.fit(gaitfit.ray.fit, "absent", logs="nowhere.csv")
        with mock.patch("gaitfit._gaitfit.__version__", "0.0.9"):
            with self.assertRaisesRegex(gaitfit.GaitfitError, "and the driver has 0.0.9"):
                self.fit(gaitfit.ray.fit, "other")
        from gaitfit.ray._fit import Crew

        honest = Crew.open
        with mock.patch.object(Crew, "open", lambda crew, parcel, mark: honest(crew, parcel, "matcho 0")):
            with self.assertRaisesRegex(gaitfit.GaitfitError, "computes other bits"):
                self.fit(gaitfit.ray.fit, "bits")
        with mock.patch.object(Crew, "open", lambda crew, parcel, mark: honest(crew, b"no parcel", mark)):
            with self.assertRaisesRegex(gaitfit.GaitfitError, "parcel cannot be unpacked"):
                self.fit(gaitfit.ray.fit, "parcel")
        with self.assertRaisesRegex(ValueError, "is connected to"):
            self.fit(gaitfit.ray.fit, "elsewhere", address="10.0.0.1:6379")
        self.assertTrue(ray.is_initialized())

    def test_a_policy_that_is_a_function_is_sent(self) -> None:
        import gaitfit.ray

        gaitfit.collect(FILE, self.folder / "logs", trajectories=10, seconds=2.5, progress=False)
        settings = {**ONE, "optimizer.seeds": 1, "optimizer.generations": 2, "optimizer.population": 12}
        layers = LAYERS

        def act(observation: np.ndarray) -> np.ndarray:
            # What it needs travels with it: the tests' modules are not on the nodes.
            for number, (weight, bias) in enumerate(layers):
                observation = observation @ weight.T + bias
                if number < len(layers) - 1:
                    observation = np.where(observation > 0, observation, np.expm1(np.minimum(observation, 0)))
            return observation

        def fit(fit: object, name: str, act: object = act) -> gaitfit.FitResult:
            policy = Policy(act, FILE, name="network")
            return fit(
                logs=self.folder / "logs", policy=policy, costs="wass", settings=settings, runs=self.folder, name=name,
                progress=False,
            )

        act.__module__ = "__main__"
        self.assertEqual(found(fit(gaitfit.ray.fit, "shared")), found(fit(gaitfit.fit, "alone")))
        lock = threading.Lock()
        with self.assertRaisesRegex(TypeError, "cannot be sent to workers"):
            fit(gaitfit.ray.fit, "locked", lambda observation: lock and observation)
        driver = os.getpid()

        def breaks(observation: np.ndarray) -> np.ndarray:
            if os.getpid() != driver:
                raise LookupError("no network here")
            return act(observation)

        breaks.__module__ = "__main__"
        with self.assertRaisesRegex(LookupError, "no network here"):
            fit(gaitfit.ray.fit, "broken", breaks)

    def test_gpus_are_asked_of_ray(self) -> None:
        import ray
        from gaitfit.ray._cluster import Cluster, Place
        from gaitfit.ray._workers import Workers

        node = self.cluster.add_node(num_cpus=1, num_gpus=2, object_store_memory=10**8)
        self.cluster.wait_for_nodes()
        try:
            cluster = Cluster(None, Place(num_cpus=0, num_gpus=0.5, retries=0))
            self.assertEqual(cluster.places(), 4)
            asked = {}

            def remote(**options: object) -> object:
                asked.update(options)
                return ray_remote(**options)

            ray_remote = ray.remote
            with mock.patch.object(ray, "remote", remote):
                workers = Workers(cluster, "simulated", ("key", cluster.put((b"no parcel", b"")), 1, "cuda"))
                # It runs on the node with GPUs, and asks for CUDA there: this machine has none, or the parcel is none.
                with self.assertRaises(gaitfit.GaitfitError):
                    list(workers.answers([b""]))
            workers.end()
            self.assertEqual((asked["num_cpus"], asked["num_gpus"], asked["max_restarts"]), (0, 0.5, 0))
            self.assertEqual(cluster.place.device, "cuda")
        finally:
            self.cluster.remove_node(node)

    def test_each_task_has_a_gpu_of_its_own(self) -> None:
        """Ray counts GPUs that are not there; tasks say where they run and which GPU is the first that they see."""
        from gaitfit.ray import _cluster
        from gaitfit.ray._workers import Workers

        def entry(streams: bool) -> object:
            def run(_version: str, _name: str, *arguments: object) -> object:
                import os
                import time

                import ray

                time.sleep(0.2)
                node = ray.get_runtime_context().get_node_id()
                return node, os.environ.get("CUDA_VISIBLE_DEVICES"), os.getpid(), arguments[-1]

            def stream(*arguments: object) -> object:
                yield run(*arguments)

            return stream if streams else run

        nodes = [self.cluster.add_node(num_cpus=2, num_gpus=2, object_store_memory=10**8) for _ in range(2)]
        self.cluster.wait_for_nodes()
        try:
            with mock.patch.object(_cluster, "_entry", entry):
                cluster = _cluster.Cluster(None, _cluster.Place(num_cpus=1, num_gpus=1, retries=0))
                self.assertEqual((cluster.places(), cluster.place.device), (4, "cuda"))
                workers = Workers(cluster, "simulated", ())
                found = [answer[1] for answer in workers.answers([b"%d" % number for number in range(24)]) if answer]
                workers.end()
                self.assertEqual(sorted(int(task) for *_, task in found), list(range(24)))
                # A worker keeps its GPU, nobody else has it, and "cuda" is the one that it sees.
                places = {(node, gpu, pid) for node, gpu, pid, _ in found}
                self.assertEqual(sorted(gpu for _, gpu, _ in places), ["0", "0", "1", "1"])
                self.assertEqual(len({node for node, *_ in places}), 2)
                # Cells and seeds: a process that has begun with one GPU is not used again for another.
                begin = cluster.remote("made", streams=True, max_retries=0)
                left = [begin(number) for number in range(8)]
                seen = [cluster.next(stream) for stream in left]
                self.assertTrue({gpu for _, gpu, *_ in seen} <= {"0", "1"}, seen)
                by_process = {}
                for _, gpu, pid, _ in seen:
                    by_process.setdefault(pid, set()).add(gpu)
                self.assertTrue(all(len(gpus) == 1 for gpus in by_process.values()), by_process)
        finally:
            for node in nodes:
                self.cluster.remove_node(node)

    def test_ctrl_c_stops_a_shared_fit_within_a_second(self) -> None:
        import gaitfit.ray

        pressed = []

        def press() -> None:
            pressed.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        begun: list[threading.Timer] = []

        def progress(event: gaitfit.Event) -> None:
            # While the search runs: on a busy machine the workers' start takes longer than any fixed time.
            if event.kind == "step" and not begun:
                begun.append(threading.Timer(0.3, press))
                begun[0].start()

        # It ends by itself, too late, if nothing stops it.
        long = {**SETTINGS, "optimizer.generations": 100_000, "optimizer.tolerance": 1e-300, "optimizer.max_seconds": 120.0}
        with self.assertRaises(KeyboardInterrupt):
            gaitfit.ray.fit(DEMO / "adapt.toml", runs=self.folder, name="stopped", settings=long, progress=progress)
        # Within a second on a quiet machine. By itself it ends after two minutes, and without the exception.
        took = time.monotonic() - pressed[0]
        print(f"Ctrl-C took {took:.2f} s")
        self.assertLess(took, 20.0)


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

        settings = {"train.environments": 64, "train.iterations": 3}
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

        settings = {"train.environments": 64, "train.iterations": 3}
        arguments = {"seeds": [1, 2], "settings": settings, "runs": self.folder, "progress": False}
        gaitfit.finetune(FILE, name="alone", **arguments)
        shared = gaitfit.ray.finetune(FILE, name="shared", **arguments).to_dict()
        for seed in (1, 2):
            policies = [(self.folder / name / f"seed-{seed}" / "policy.safetensors").read_bytes() for name in ("alone", "shared")]
            self.assertEqual(*policies)
        self.assertEqual(gaitfit.ray.finetune(FILE, name="shared", resume=True, **arguments).to_dict()["seeds"], shared["seeds"])


if __name__ == "__main__":
    unittest.main()
