"""The cluster: connecting to it, and what tasks need of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .. import _gaitfit

#: How long to wait for an answer before saying that nothing happened, s.
PATIENCE = 0.1
#: Max number of characters of Ray's message in one of ours.
SAID = 300
#: How long what the cluster has is taken as known, s.
KNOWN = 2.0


def library() -> Any:
    """The package ``ray``."""
    try:
        import ray
    except ImportError as error:
        raise ImportError('gaitfit.ray needs Ray, which is not installed: pip install "gaitfit[ray]"') from error
    return ray


@dataclass(frozen=True)
class Place:
    """What a task takes of a node: CPUs and GPUs, as Ray counts them, and how often it runs again after a node is lost."""

    num_cpus: float
    num_gpus: float
    retries: int

    def __post_init__(self) -> None:
        for name in ("num_cpus", "num_gpus"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} is {value!r}; it must be a number of at least 0")
        if self.num_cpus == 0 and self.num_gpus == 0:
            raise ValueError("num_cpus and num_gpus are both 0; a task needs one of them")
        if not isinstance(self.retries, int) or self.retries < 0:
            raise ValueError(f"retries is {self.retries!r}; it must be a whole number of at least 0")

    @property
    def threads(self) -> int:
        return max(1, int(self.num_cpus))

    @property
    def device(self) -> str:
        return "cuda" if self.num_gpus > 0 else "cpu"

    def count(self, resources: dict[str, float]) -> int:
        """How many tasks fit into such resources at the same time."""
        needed = {"CPU": self.num_cpus, "GPU": self.num_gpus}
        return min(int(resources.get(name, 0.0) / each + 1e-9) for name, each in needed.items() if each > 0)


class Cluster:
    """A Ray cluster, of which every node has gaitfit."""

    def __init__(self, address: str | None, place: Place) -> None:
        self._ray = ray = library()
        self.place = place
        if not ray.is_initialized():
            ray.init(address=address, logging_level="warning", log_to_driver=False)
        elif address not in (None, "auto", "local", ray.get_runtime_context().gcs_address):
            here = ray.get_runtime_context().gcs_address
            raise ValueError(f"Ray is connected to {here} already, not to {address}: call ray.shutdown() first")
        self._known = (-math.inf, 0)
        if self.places() < 1:
            have = ", ".join(f"{value:g} {name}" for name, value in self._resources().items() if name in ("CPU", "GPU"))
            raise _gaitfit.GaitfitError(
                f"no node of the Ray cluster has {place.num_cpus:g} CPUs and {place.num_gpus:g} GPUs for a task; the nodes have "
                f"{have or 'nothing'} in all. Lower num_cpus or num_gpus."
            )

    def _resources(self) -> dict[str, float]:
        resources: dict[str, float] = self._ray.cluster_resources()
        return resources

    def places(self) -> int:
        """Tasks that fit into the nodes at the same time."""
        at, count = self._known
        if time.monotonic() - at > KNOWN:
            nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
            count = sum(self.place.count(node) for node in nodes)
            self._known = (time.monotonic(), count)
        return count

    def put(self, value: Any) -> Any:
        """Puts a value into the object store; a list with its reference, so that tasks fetch it only if they need it."""
        return [self._ray.put(value)]

    def remote(self, name: str, *, streams: bool = False, **options: Any) -> Callable[..., Any]:
        """The function ``name`` of :mod:`gaitfit.ray._worker` as a task; one that ``streams`` gives many answers."""
        place = self.place
        wanted = {"num_cpus": place.num_cpus, "num_gpus": place.num_gpus, "max_retries": place.retries, **options}
        if streams:
            wanted["num_returns"] = "streaming"
        begin = self._ray.remote(**wanted)(_entry(streams)).remote
        return lambda *arguments: begin(_gaitfit.__version__, name, *arguments)

    def actor(self, options: Mapping[str, Any], *arguments: Any) -> Any:
        """A process that does one task after another, see :func:`_worker`; it is not begun again by itself."""
        place = self.place
        wanted = {"num_cpus": place.num_cpus, "num_gpus": place.num_gpus, "max_restarts": 0, **options}
        return self._ray.remote(**wanted)(_worker()).remote(_gaitfit.__version__, *arguments)

    def end(self, actor: Any) -> None:
        """Ends an actor at once, whatever it does."""
        self._ray.kill(actor)

    def ready(self, streams: Sequence[Any]) -> Sequence[Any]:
        """Tasks that are done, and streams of which the next answer, or the end, is there; none where nothing came for a
        moment."""
        ready: list[Any] = self._ray.wait(list(streams), num_returns=1, timeout=PATIENCE)[0]
        return ready

    def next(self, stream: Any) -> Any | None:
        """The next answer of a stream; ``None`` at its end."""
        try:
            return self._get(next(stream))
        except StopIteration:
            return None

    def give_up(self, task: Any) -> None:
        """Does not wait for a task any more."""
        self._ray.cancel(task, force=False)

    @property
    def lost(self) -> tuple[type[Exception], ...]:
        """Errors of a node or a worker that is gone."""
        found = self._ray.exceptions
        return (Lost, found.ObjectLostError)

    @property
    def _gone(self) -> tuple[type[Exception], ...]:
        found = self._ray.exceptions
        return (found.WorkerCrashedError, found.NodeDiedError, found.OutOfMemoryError, found.RayActorError)

    def get(self, reference: Any) -> Any:
        """What a task gave; raises what it raised, or :class:`Lost`."""
        return self._get(reference)

    def _get(self, reference: Any) -> Any:
        ray = self._ray
        try:
            return ray.get(reference)
        except ray.exceptions.RayTaskError as error:
            # What the task raised, as it raised it.
            cause = getattr(error, "cause", None)
            if isinstance(cause, Exception):
                raise cause from None
            raise _gaitfit.GaitfitError(str(error)) from None
        except self._gone as error:
            raise Lost(self.why(error)) from None

    def why(self, error: Exception) -> str:
        """Why a worker is gone, in words, with the first line of Ray's message, as the end of a sentence with "because"."""
        if isinstance(error, Lost):
            return str(error)
        found = self._ray.exceptions
        words = next(
            (
                words
                for kind, words in (
                    (found.OutOfMemoryError, "its node had too little memory, so Ray ended it"),
                    (found.NodeDiedError, "its node left the cluster"),
                    (found.ObjectLostError, "a node left the cluster, and data that it needs went with the node"),
                )
                if isinstance(error, kind)
            ),
            "its process crashed or was ended",
        )
        said = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        return f"{words} (Ray: {said[:SAID]})" if said else words


class Lost(_gaitfit.GaitfitError):
    """A node or a worker is gone, and with it what it did."""


def often_lost(what: str, times: int, retries: int, why: str, kept: str) -> str:
    """The message about work whose workers were lost too often.

    ``what``: the work; ``times``: how many workers it lost; ``retries``: how many it may lose; ``why``: what :meth:`Cluster.why`
    says of the last one; ``kept``: which results are kept, and how to continue.
    """
    lost = (
        "a worker of the Ray cluster was lost while it did this"
        if times == 1
        else f"{times} workers of the Ray cluster were lost one after another while they did this"
    )
    last = "the reason:" if times == 1 else "the reason for the last one:"
    return (
        f"{what}: {lost} (retries={retries}); {last} {why}. {kept} First find out why workers are lost: `ray status` lists the nodes, and "
        "/tmp/ray/session_latest/logs on a node has what its workers wrote. If memory is short, a larger num_cpus puts "
        "fewer tasks on a node."
    )


def _worker() -> type:
    # As below: a class within a function is sent by its text.
    run = _entry(False)

    class Worker:
        def __init__(self, version: str, *given: Any) -> None:
            self._version, self._given = version, given

        def begin(self) -> None:
            """Says that there is a process."""

        def work(self, name: str, task: bytes) -> Any:
            return run(self._version, name, *self._given, task)

    return Worker


def _entry(streams: bool) -> Callable[..., Any]:
    # A function within a function is sent by its text: a node with another gaitfit, or none, can say so.
    def run(version: str, name: str, *arguments: Any) -> Any:
        import platform

        try:
            import gaitfit
        except ImportError as error:
            raise RuntimeError(
                f"the node {platform.node()} cannot import gaitfit ({error}): install the same version there, or send it with "
                "ray.init(runtime_env={'pip': [...]})"
            ) from None
        if gaitfit.__version__ != version:
            raise gaitfit.GaitfitError(
                f"the node {platform.node()} has gaitfit {gaitfit.__version__}, and the driver has {version}: install the "
                "same version"
            )
        from gaitfit.ray import _worker

        return getattr(_worker, name)(*arguments)

    def stream(version: str, name: str, *arguments: Any) -> Iterator[Any]:
        yield from run(version, name, *arguments)

    return stream if streams else run
