"""Fits whose candidates are shared among workers."""

# Without Ray this folder is what a checker finds by that name.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from .. import _gaitfit
from .._policy import Policy
from .._progress import Progresses, listener
from ..results import FitResult, Named, Sharing
from ..results import _read
from .. import _given as given
from .._given import PathLike, Resume, Settings
from .._logs import Log
from ..config import Cost, Fit
from ._cluster import Cluster, Place, library
from ._limit import Limit
from ._workers import Workers


def fit(
    config: PathLike | Fit | None = None,
    *,
    logs: PathLike | Log | Sequence[PathLike | Log] | None = None,
    robot: PathLike | None = None,
    policy: PathLike | Policy | None = None,
    costs: Cost | Sequence[Cost] | None = None,
    settings: Settings | None = None,
    name: str | None = None,
    runs: PathLike | None = None,
    resume: Resume = False,
    max_seconds: float | None = None,
    threads: int | None = None,
    progress: Progresses = True,
    address: str | None = None,
    num_cpus: float = 1,
    num_gpus: float = 0,
    retries: int = 10,
) -> FitResult:
    """Fits as :func:`gaitfit.fit`, to the same bits; the workers of a Ray cluster simulate the candidates.

    Arguments:
        config, logs, robot, policy, costs, settings, name, runs, resume, progress: As for :func:`gaitfit.fit`.
        max_seconds: As for :func:`gaitfit.fit`; the time to reach the cluster counts too.
        threads: Threads of this process.
        address: The cluster's, as :func:`ray.init` takes it.
        num_cpus: CPUs of a task, and its threads.
        num_gpus: GPUs of a task; above 0 the candidates are simulated there.
        retries: How often the task of a lost worker runs again.

    Returns the result, with :attr:`FitResult.sharing`.

    Raises as :func:`gaitfit.fit`, and :class:`GaitfitError` for a worker that computes other bits.

    The candidates of all costs and seeds are shared, also those of one cost and one seed; so are the moves of values for
    intervals and sets of simulated logs. This process computes derivatives of logs of clamped legs, and the simulated robots that
    correct ``wass``. :attr:`FitResult.sharing`, which is also printed, states what was shared and
    what this process computed alone. Robot, policy and logs are sent once to each node. This process keeps the run folder: if it
    is killed, ``resume=True`` continues from its checkpoint.

    Nodes need the same version of gaitfit. A worker that
    computes other bits than this process is refused; with ``num_gpus`` than the first worker.

    A :class:`gaitfit.Policy` of your own is sent to the workers as Ray pickles it, and called there: it needs the same
    packages on all nodes, and a function whose actions have other bits elsewhere is refused as such a worker is.

    >>> result = gaitfit.ray.fit("go2.toml", logs="walks", address="auto")      # doctest: +SKIP
    >>> result.sharing.tasks      # doctest: +SKIP
    {'costs': 2700}
    """
    limit, place = Limit(max_seconds), Place(num_cpus, num_gpus, retries)
    listen = listener(progress)
    if isinstance(policy, Policy) and num_gpus > 0:
        raise ValueError(f"the policy {policy.name} is a function, which GPUs do not simulate with: leave num_gpus out")
    others = given.fit_settings(logs, robot, given.named_policy(policy), costs, settings, runs)
    run = given.run(config, Fit, others, name, resume, threads, "cpu")
    own = _sent(policy) if isinstance(policy, Policy) else b""
    crew = Crew(Cluster(address, place), own)
    begun = time.process_time()
    try:
        run["max_seconds"] = limit.left()
        result = _read.fit_result(json.loads(_gaitfit.adapt(run, given.own(policy), listen, crew)))
        sharing = crew.sharing(time.process_time() - begun, result)
        if listen is not None:
            listen("note", str(sharing), 0, 0, {}, None)
        return replace(result, sharing=sharing)
    finally:
        crew.close()


def _sent(policy: Policy) -> bytes:
    """A policy of one's own as it is sent to workers."""
    library()
    from ray import cloudpickle

    try:
        sent: bytes = cloudpickle.dumps(policy)  # type: ignore[no-untyped-call, unused-ignore]
        return sent
    except Exception as error:
        raise TypeError(
            f"the policy {policy.name} cannot be sent to workers ({error}): give a function that makes what cannot be "
            "pickled, such as an ONNX session, where it is called first"
        ) from error


#: Kinds of work, by the name that a task has for it.
KINDS = {b'"Costs"': "costs", b'"Views"': "intervals", b'"Signals"': "signals", b'"Ask"': "corrections"}


class Crew:
    """The workers of a fit; the native half calls it."""

    def __init__(self, cluster: Cluster, policy: bytes = b"") -> None:
        self._cluster, self._policy = cluster, policy
        self._workers: Workers | None = None
        self._tasks, self._seconds = dict[str, int](), dict[str, float]()
        #: Whether this process computes as the workers do.
        self.alike = cluster.place.num_gpus == 0

    def open(self, parcel: bytes, mark: str) -> None:
        """Takes what workers need, and what they are to find."""
        self._mark = mark if self.alike else None
        self._key = hashlib.sha256(parcel + self._policy).hexdigest()
        place = self._cluster.place
        self._parcel = self._cluster.put((parcel, self._policy))
        given = (self._key, self._parcel, place.threads, place.device)
        self._workers = Workers(self._cluster, "simulated", given)

    def close(self) -> None:
        """Ends the workers."""
        if self._workers is not None:
            self._workers.end()

    def sharing(self, driver_seconds: float, result: FitResult) -> Sharing:
        """What workers did for a fit, of which this process computed so long."""
        alone = ["the search's own arithmetic"]
        if result.validation or result.held_out is not None:
            alone.append("validation logs")
        settings = json.loads(_gaitfit.read_toml((result.run_folder / "config.toml").read_text(encoding="utf-8")))
        free, costs = settings["base"] == "free", {fit.cost_name for fit in result.fits}
        # Least squares of free simulations, whose derivatives the engine has; other costs begin at what sensors read, and their
        # derivatives are differences of simulations, which workers do.
        if settings["optimizer"]["method"] == "least-squares" and not free and "matcho" in costs:
            if settings["simulation"]["preset"] != "converged":
                alone.append("derivatives of logs of clamped legs")
        if free and "wass" in costs:
            alone.append("simulated robots that correct wass")
        return Sharing(Named(self._tasks), Named(self._seconds), driver_seconds, (*alone, "the report"))

    def places(self) -> int:
        return self._cluster.places()

    def work(self, tasks: Sequence[bytes]) -> Iterator[tuple[int, bytes] | None]:
        assert self._workers is not None, "open() comes first"
        for answer in self._workers.answers(tasks):
            if answer is None:
                yield None
                continue
            number, (where, mark, found, seconds) = answer
            self._seconds[where] = self._seconds.get(where, 0.0) + seconds
            kind = next((words for sign, words in KINDS.items() if sign in tasks[number]), "others")
            self._tasks[kind] = self._tasks.get(kind, 0) + 1
            self._mark = self._mark or mark
            if mark != self._mark:
                raise _gaitfit.GaitfitError(
                    f"the worker {where} computes other bits: where the search begins it finds {mark}, and needed is "
                    f"{self._mark}. Give all nodes the same build of gaitfit and processors with AVX2; GPUs must be alike, and a "
                    "policy of your own must act the same everywhere."
                )
            yield number, found
