"""Fits on a Ray cluster of three nodes."""

import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
import unittest
from unittest import mock

import numpy as np

import gaitfit
from gaitfit import Policy

from .common import DEMO, PACKAGE, Case
from .test_own_policy import FILE, LAYERS

RAY = importlib.util.find_spec("ray") is not None
#: One number instead of the dozens of a walk's fit: a policy that is a function is slow.
ONE = {"parameter": [{"kind": "frictionloss", "per": "all", "upper": 0.8}]}
SETTINGS = {"optimizer.generations": 10, "optimizer.seeds": 2, "costs": ["matcho", "wass"], "checkpoint_seconds": 0.0}


def found(results: gaitfit.FitResult) -> object:
    """What a fit found, without times and places."""
    document = results.to_dict()
    return [document["parameters"], document["cost"], [[fit["cost"], fit["parameters"]] for fit in document["fits"]]]


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
