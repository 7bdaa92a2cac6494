"""The native half. The package's own functions are the interface; this one may change."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

class GaitfitError(Exception): ...
class Stopped(GaitfitError):
    run_folder: Path | None

#: Kind, text, done, total and numbers by name; False stops the stage.
Listener = Callable[[Any, str, int, int, Mapping[str, float]], bool]

class PolicyFile:
    interface: str
    task: str
    is_recurrent: bool
    state_width: int
    notes: list[str]
    def __init__(self, path: str) -> None: ...
    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]: ...
    def act_from(
        self, observation: NDArray[np.float32], state: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
    def reset(self, rows: Sequence[int] | None) -> None: ...
    def networks(self) -> dict[str, Any]: ...

class Cma:
    def __init__(
        self,
        start: Sequence[float],
        deviation: Sequence[float],
        seed: int,
        lower: Sequence[float] | None,
        upper: Sequence[float] | None,
        population: int | None,
        reflect: bool,
        separable: bool,
        state: str | None,
    ) -> None: ...
    def ask(self) -> NDArray[np.float64]: ...
    def tell(self, costs: NDArray[np.float64]) -> None: ...
    def stop(self) -> str | None: ...
    def best(self) -> tuple[NDArray[np.float64], float] | None: ...
    def mean(self) -> NDArray[np.float64]: ...
    def deviations(self) -> NDArray[np.float64]: ...
    def sigma(self) -> float: ...
    def generation(self) -> int: ...
    def evaluations(self) -> int: ...
    def state(self) -> str: ...

class Helper:
    mark: str
    def __init__(
        self, parcel: bytes, threads: int, device: str, policy: Mapping[str, Any] | None = None
    ) -> None: ...
    def work(self, task: bytes) -> bytes: ...

class DeviceArray:
    shape: tuple[int, ...]
    dtype: str
    device: str
    def numpy(self) -> NDArray[Any]: ...
    def __dlpack_device__(self) -> tuple[int, int]: ...
    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any: ...

class DeviceInput:
    address: int
    def __init__(self, what: str, array: Any, shape: tuple[int, int], device: int, stream: int) -> None: ...

class Task:
    observation_width: int
    critic_width: int
    action_width: int
    action_bounds: list[list[float]]
    joints: list[str]
    control_dt: float
    episode_steps: int
    rewards: list[str]
    interface: str
    settings: str
    shape: str
    def __init__(self, config: str | None, sets: Sequence[str], robot: str | None) -> None: ...

class CudaRobots:
    count: int
    device: int
    stream: int
    diverged: int
    def __init__(self, task: Task, count: int, seed: int, stagger: bool, autoreset: bool, device: str) -> None: ...
    def array(self, name: str) -> DeviceArray: ...
    def step(self, actions: DeviceInput) -> int: ...
    def motion(self) -> list[DeviceArray]: ...
    def restart(self, mask: NDArray[np.bool_] | None = None) -> None: ...
    def take_terms(self) -> list[float]: ...
    def show(self, robots: Robots) -> None: ...
    def follow(self, robots: Robots) -> None: ...

class Robots:
    count: int
    diverged: int
    def __init__(
        self,
        task: Task,
        count: int,
        seed: int,
        threads: int | None,
        stagger: bool,
        autoreset: bool,
    ) -> None: ...
    def observe(self, observation: NDArray[np.float32], critic: NDArray[np.float32]) -> None: ...
    def step(
        self,
        actions: NDArray[np.float32],
        observation: NDArray[np.float32],
        critic: NDArray[np.float32],
        last: NDArray[np.float32],
        reward: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> int: ...
    def restart(self, mask: NDArray[np.bool_] | None = None) -> None: ...
    def commands(self) -> list[list[float]]: ...
    def pose(self, index: int) -> tuple[list[float], list[float], list[float]]: ...
    def motion(self) -> list[NDArray[np.float32]]: ...
    def take_terms(self) -> list[float]: ...
    def state(self) -> tuple[NDArray[np.float32], NDArray[np.uint32], int]: ...
    def set_state(self, numbers: NDArray[np.float32], steps: NDArray[np.uint32], step: int) -> None: ...

def wasserstein(a: NDArray[np.float64], b: NDArray[np.float64]) -> list[float]: ...
def read_log(path: str, allow: list[str]) -> dict[str, Any]: ...
def write_log(path: str, log: Mapping[str, Any]) -> None: ...
def check_log(log: Mapping[str, Any]) -> str: ...
def read_toml(text: str) -> str: ...
def resolve_settings(stage: str, sets: Sequence[str]) -> str: ...
def fit_simulator(
    simulate: Callable[[NDArray[np.float64]], Sequence[Mapping[str, Any]]],
    joints: Sequence[str],
    logs: Sequence[Mapping[str, Any]],
    parameters: Sequence[Mapping[str, Any]],
    search: Mapping[str, Any],
    progress: Listener | None,
) -> str: ...
def interface_of(path: str) -> tuple[str, str]: ...
def observation_width(interface: str) -> int: ...
def adapt(
    run: Mapping[str, Any],
    policy: Mapping[str, Any] | None,
    progress: Listener | None,
    crew: Any | None,
) -> str: ...
def adapt_plan(run: Mapping[str, Any]) -> tuple[str, list[str]]: ...
def validate(
    theta: str,
    logs: Sequence[str],
    config: str | None,
    sets: Sequence[str],
    threads: int | None,
    policy: Mapping[str, Any] | None,
) -> str: ...
def train(
    run: Mapping[str, Any],
    robot: str | None,
    seeds: Sequence[int] | None,
    progress: Listener | None,
) -> str: ...
def train_plan(
    run: Mapping[str, Any],
    robot: str | None,
    seeds: Sequence[int] | None,
) -> tuple[str, str, list[int], list[str]]: ...
def finetune_plan(
    run: Mapping[str, Any],
    world: Mapping[str, Any],
    seeds: Sequence[int] | None,
) -> tuple[str, str, list[int], list[str]]: ...
def finetune(
    run: Mapping[str, Any],
    world: Mapping[str, Any],
    seeds: Sequence[int] | None,
    progress: Listener | None,
) -> str: ...
def run_loop(run: Mapping[str, Any], progress: Listener | None) -> str: ...
def evaluate(
    world: Mapping[str, Any],
    trajectories: int,
    seconds: float,
    drift: int,
    terrain: str,
    device: str,
    progress: Listener | None,
) -> str: ...
def collect(
    world: Mapping[str, Any],
    out: str,
    trajectories: int,
    seconds: float,
    log_shift: Sequence[float],
    privileged: bool,
    commands: str | None,
    device: str,
    progress: Listener | None,
) -> tuple[str, list[str], int]: ...
def reproduce(table: Mapping[str, Any], progress: Listener | None) -> str: ...
def reproduce_plan(table: Mapping[str, Any]) -> str: ...
def reproduce_part(
    table: Mapping[str, Any],
    part: str,
    progress: Listener | None,
) -> None: ...

def program(arguments: Sequence[str]) -> int: ...
