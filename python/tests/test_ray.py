"""Ray: the bits of one machine on a cluster of three nodes, whoever is lost on the way."""

import json
import os
import pickle
import sys
import unittest
from types import SimpleNamespace
from unittest import mock

import numpy as np

import gaitfit
from gaitfit import Policy
from gaitfit._given import fit_settings, run as run_of
from gaitfit.config import Fit
from gaitfit.results._read import fit_result

from .common import DEMO, ROOT, Case
from .test_own_policy import FILE, network

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


class Lossy:
    """A cluster that loses workers: each sends one file and is then lost."""

    def __init__(self, retries: int, lost: Exception) -> None:
        from gaitfit.ray._cluster import Cluster

        self.place, self._lost, self.why = SimpleNamespace(retries=retries), lost, lambda error: Cluster.why(self, error)
        self.lost, self._begun = (type(lost),), 0
        names = ("OutOfMemoryError", "NodeDiedError", "ObjectLostError")
        kinds = {name: type(name, (Exception,), {}) for name in names if name != type(lost).__name__}
        self._ray = SimpleNamespace(exceptions=SimpleNamespace(**{type(lost).__name__: type(lost)}, **kinds))

    def places(self) -> int:
        return 1

    def put(self, value: object) -> object:
        return [value]

    def remote(self, name: str, **options: object) -> object:
        return lambda *arguments: iter([{f"step-{len(arguments[2][arguments[3]][0])}.txt": b"done"}])

    def ready(self, streams: list) -> list:
        return streams[:1]

    def next(self, stream: object) -> object:
        for files in stream:
            return files
        raise self._lost

    def give_up(self, stream: object) -> None:
        pass


class Losses(Case):
    def test_what_is_lost_too_often_is_named_with_the_cause_and_what_is_kept(self) -> None:
        from gaitfit.ray._limit import Limit
        from gaitfit.ray._orders import Order, Orders

        for kind, said, why in (
            ("OutOfMemoryError", "Task was killed due to the node running low on memory.\nMemory on the node", "too little memory"),
            ("NodeDiedError", "", "its node left the cluster"),
            ("WorkerCrashedError", "The worker died unexpectedly", "its process crashed or was ended"),
        ):
            events, folder = [], self.folder / kind
            cluster = Lossy(2, type(kind, (Exception,), {})(said))
            listen = lambda kind, text, *_: events.append((kind, text)) or True  # noqa: E731
            orders = Orders(cluster, {}, 1.0, listen, Limit(None), folder)
            part = os.path.relpath(folder / "seed-3")
            with self.subTest(kind), self.assertRaises(gaitfit.GaitfitError) as raised:
                orders.make([Order("go2, seed 3", part, [], {"what": "training"})])
            text = str(raised.exception)
            self.assertRegex(text, "^the training go2, seed 3: 3 workers of the Ray cluster were lost")
            self.assertRegex(text, why)
            for words in (part, "resume=True", "retries=2", "num_cpus", "ray status", said.split("\n")[0]):
                self.assertIn(words, text)
            notes = [text for kind, text in events if kind == "note"]
            self.assertEqual(len(notes), 2)
            self.assertRegex(notes[0], f"^the training go2, seed 3: its worker was lost, because .*{why}.*; another continues it$")
            # Each worker had what those before it had sent.
            self.assertEqual(sorted(file.name for file in (folder / "seed-3").iterdir()), ["step-0.txt", "step-1.txt", "step-2.txt"])

    def test_one_lost_worker_is_one(self) -> None:
        from gaitfit.ray._cluster import often_lost

        self.assertRegex(often_lost("the fit", 1, 0, "its node left", "Nothing is kept."), r"^the fit: a worker .* \(retries=0\); the reason: its node left\.")


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


if __name__ == "__main__":
    unittest.main()
