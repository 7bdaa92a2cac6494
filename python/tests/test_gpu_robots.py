"""Robots on a GPU: what is taken and given by DLPack, and that they are the processor's robots.

Where there is no GPU, or no PyTorch that uses it, tests that need them are skipped and say so.
"""

import ctypes
import gc
import unittest
from typing import Any

import numpy as np

import gaitfit
from gaitfit import _gaitfit

from .common import Case, GpuCase

CPU, CUDA = 1, 2
FLOAT, INT = 2, 0


class _Device(ctypes.Structure):
    _fields_ = [("kind", ctypes.c_int32), ("number", ctypes.c_int32)]


class _Type(ctypes.Structure):
    _fields_ = [("code", ctypes.c_uint8), ("bits", ctypes.c_uint8), ("lanes", ctypes.c_uint16)]


class _Tensor(ctypes.Structure):
    _fields_ = [
        ("data", ctypes.c_void_p),
        ("device", _Device),
        ("axes", ctypes.c_int32),
        ("dtype", _Type),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.POINTER(ctypes.c_int64)),
        ("offset", ctypes.c_uint64),
    ]


class _Managed(ctypes.Structure):
    pass


_DELETER = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Managed))
_Managed._fields_ = [("tensor", _Tensor), ("context", ctypes.c_void_p), ("deleter", _DELETER)]
_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype, _new_capsule.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]


class Pretender:
    """Says that it is an array on a GPU, and has no memory."""

    address = 0x7F00_0000_0000

    def __init__(self, shape: tuple[int, ...] = (4, 12), strides: tuple[int, ...] | None = None, **others: Any) -> None:
        self.device, self.streams, self.freed = (CUDA, others.get("device", 0)), [], 0
        self.inside = others.get("inside", self.device)
        self._shape = (ctypes.c_int64 * len(shape))(*shape)
        self._strides = None if strides is None else (ctypes.c_int64 * len(strides))(*strides)
        self._deleter = _DELETER(self._free)
        code, bits = others.get("dtype", (FLOAT, 32))
        self._managed = _Managed(
            _Tensor(
                self.address,
                _Device(*self.inside),
                len(shape),
                _Type(code, bits, 1),
                self._shape,
                self._strides,
                others.get("offset", 0),
            ),
            None,
            self._deleter,
        )

    def _free(self, _: Any) -> None:
        self.freed += 1

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.device

    def __dlpack__(self, *, stream: int | None = None) -> Any:
        self.streams.append(stream)
        return _new_capsule(ctypes.addressof(self._managed), b"dltensor", None)


def given(array: Any, stream: int = 77) -> _gaitfit.DeviceInput:
    return _gaitfit.DeviceInput("actions", array, (4, 12), 0, stream)


class Inputs(Case):
    def test_an_array_on_a_gpu_is_taken_where_it_lies_and_held(self) -> None:
        for strides, offset in ((None, 0), ((12, 1), 96)):
            array = Pretender(strides=strides, offset=offset)
            taken = given(array)
            self.assertEqual((taken.address, array.streams, array.freed), (array.address + offset, [77], 0))
            del taken
            gc.collect()
            self.assertEqual(array.freed, 1)

    def test_what_is_no_such_array_is_refused(self) -> None:
        for array, error, words in (
            ([[0.0] * 12] * 4, TypeError, r"32-bit floats on cuda:0; they are a list, which has no __dlpack__"),
            (np.zeros((4, 12), np.float32), TypeError, r"they lie on the processor.*actions.to\(\"cuda:0\"\)"),
            (Pretender(device=1), ValueError, "they lie on cuda:1"),
            (Pretender(inside=(CPU, 0)), ValueError, "another device than they say"),
            (Pretender(dtype=(FLOAT, 64)), TypeError, "of 64 bits"),
            (Pretender(dtype=(INT, 32)), TypeError, "kind 0 of DLPack"),
            (Pretender((4, 11)), ValueError, r"shape \(4, 11\); needed: \(4, 12\)"),
            (Pretender((48,)), ValueError, r"shape \(48\); needed: \(4, 12\)"),
            (Pretender(strides=(1, 4)), ValueError, r"one block of memory, row by row"),
            (Pretender(strides=(24, 1)), ValueError, r"one block of memory, row by row"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                given(array)
            if isinstance(array, Pretender):
                gc.collect()
                self.assertEqual(array.freed, len(array.streams), "what was taken is let go")

    def test_a_device_that_is_none_is_refused(self) -> None:
        for device, error in (("gpu", ValueError), ("cuda:x", ValueError), (0, TypeError), (None, TypeError)):
            with self.subTest(device=device), self.assertRaisesRegex(error, "device is"):
                gaitfit.Robots(num_envs=4, device=device)
        # There is no machine with so many.
        with self.assertRaises(gaitfit.GaitfitError):
            gaitfit.Robots(num_envs=4, device="cuda:4000")


class OnGpu(GpuCase):
    def test_they_are_the_processors_robots(self) -> None:
        torch, count, steps = self.torch, 300, 50
        common: dict[str, Any] = {"num_envs": count, "seed": 4, "stagger": True, "settings": {"task.episode_seconds": 0.6}}
        cpu, gpu = gaitfit.Robots(**common), gaitfit.Robots(**common, device="cuda")
        self.assertEqual((cpu.device, gpu.device, cpu.interface, cpu.task), ("cpu", "cuda:0", gpu.interface, gpu.task))
        names = ("observation", "critic_observation", "last_observation", "reward", "terminated", "truncated")
        views = {name: torch.from_dlpack(getattr(gpu, name)) for name in names}
        places = {name: view.data_ptr() for name, view in views.items()}
        start = np.abs(views["observation"].cpu().numpy() - cpu.observation).max()
        self.assertLess(start, 1e-5)
        together, ends = np.ones(count, bool), 0
        for step, action in enumerate(self.actions(count, steps)):
            cpu.step(action)
            ended = gpu.step(torch.from_numpy(action).cuda())
            found = {name: view.cpu().numpy() for name, view in views.items()}
            self.assertEqual(ended, (found["terminated"] | found["truncated"]).sum())
            np.testing.assert_array_equal(gpu.ended.numpy(), found["terminated"] | found["truncated"])
            ends += ended
            # One that fell in one simulation and not in the other has parted for good.
            together &= (found["terminated"] == cpu.terminated) & (found["truncated"] == cpu.truncated)
            np.testing.assert_array_equal(torch.from_dlpack(gpu.commands).cpu()[together], cpu.commands[together])
            apart = {}
            for name in ("observation", "critic_observation", "reward"):
                rows = np.abs(found[name] - getattr(cpu, name)).reshape(count, -1).max(1)[together]
                apart[name] = np.quantile(rows, [0.5, 0.9, 1.0])
            rows = together & cpu.ended
            if rows.any():
                difference = np.abs(found["last_observation"] - cpu.last_observation)[rows].max(1)
                apart["last_observation"] = np.quantile(difference, [0.5, 0.9, 1.0])
            if step < 3 or step % 10 == 9:
                print(f"step {step}: {together.sum()} together, apart (half, 9 of 10, most):", *apart.items(), sep="\n  ")
            self.assertGreater(together.mean(), 0.9)
            self.assertLess(apart["observation"][0], 5e-3 if step < 3 else 0.1)
        self.assertGreater(ends, count)
        for name in names:
            self.assertEqual(torch.from_dlpack(getattr(gpu, name)).data_ptr(), places[name], "no copy")
        self.assertEqual(views["terminated"].dtype, torch.bool)

    def test_the_same_actions_have_the_same_bits_again(self) -> None:
        torch, count = self.torch, 64
        robots = [gaitfit.Robots(num_envs=count, seed=2, device="cuda") for _ in range(2)]
        for action in self.actions(count, 30):
            for one in robots:
                one.step(torch.from_numpy(4.0 * action).cuda())
            for name in ("observation", "critic_observation", "reward", "terminated", "truncated"):
                np.testing.assert_array_equal(*(getattr(one, name).numpy() for one in robots), err_msg=name)
        first = robots[0].reset().numpy()
        np.testing.assert_array_equal(robots[1].reset().numpy(), first)
        self.assertFalse(robots[0].ended.numpy().all())

    def test_actions_are_read_where_they_lie_after_their_stream(self) -> None:
        torch = self.torch
        count = 64
        robots, twin = (gaitfit.Robots(num_envs=count, seed=2, device="cuda") for _ in range(2))
        actions = torch.zeros(count, 12, device="cuda")
        taken = _gaitfit.DeviceInput("actions", actions, (count, 12), 0, 1)
        self.assertEqual(taken.address, actions.data_ptr())
        side = torch.cuda.Stream()
        torch.cuda.synchronize()
        for value in (0.3, -0.2, 0.5):
            with torch.cuda.stream(side):
                # A tenth of a second or so in which the actions are not there yet.
                torch.cuda._sleep(200_000_000)
                actions.fill_(value)
                robots.step(actions)
            twin.step(torch.full((count, 12), value, device="cuda"))
            np.testing.assert_array_equal(robots.observation.numpy(), twin.observation.numpy())

    def test_what_was_begun_before_a_step_reads_what_was_there(self) -> None:
        torch = self.torch
        robots = gaitfit.Robots(num_envs=64, seed=2, device="cuda")
        view, actions = torch.from_dlpack(robots.observation), torch.full((64, 12), 0.4, device="cuda")
        before, copy = robots.observation.numpy(), torch.empty_like(view)
        torch.cuda._sleep(200_000_000)
        copy.copy_(view)
        robots.step(actions)
        np.testing.assert_array_equal(copy.cpu().numpy(), before)
        self.assertFalse(np.array_equal(view.cpu().numpy(), before))
        before = robots.observation.numpy()
        torch.cuda._sleep(200_000_000)
        copy.copy_(view)
        robots.reset()
        np.testing.assert_array_equal(copy.cpu().numpy(), before)

    def test_arrays_outlive_their_robots(self) -> None:
        torch = self.torch
        robots = gaitfit.Robots(num_envs=4096, seed=2, device="cuda")
        robots.step(torch.zeros(4096, 12, device="cuda"))
        array, view, flags = robots.observation, torch.from_dlpack(robots.observation), torch.from_dlpack(robots.ended)
        numbers, ended = array.numpy(), flags.cpu().numpy()
        del robots
        gc.collect()
        others = [torch.full((4096, 64), 7.0, device="cuda") for _ in range(50)]
        np.testing.assert_array_equal(view.cpu().numpy(), numbers)
        np.testing.assert_array_equal(array.numpy(), numbers)
        np.testing.assert_array_equal(flags.cpu().numpy(), ended)
        del array, view, flags, others
        gc.collect()

    def test_memory_is_given_back(self) -> None:
        torch = self.torch
        free = []
        for _ in range(4):
            robots = gaitfit.Robots(num_envs=20_000, device="cuda")
            view = torch.from_dlpack(robots.observation)
            robots.step(torch.zeros(20_000, 12, device="cuda"))
            del robots, view
            gc.collect()
            torch.cuda.synchronize()
            free.append(torch.cuda.mem_get_info()[0])
        self.assertGreaterEqual(free[3] + (1 << 20), free[1], free)

    def test_wrong_actions_are_refused_and_nothing_moves(self) -> None:
        torch, robots = self.torch, self.robots
        before = robots.observation.numpy()
        wrong = torch.zeros(4, 12, device="cuda")
        wrong[2, 3] = float("nan")
        for actions, error, words in (
            (wrong, ValueError, "the action of environment 2 for FR_hip_joint is not finite"),
            (torch.zeros(4, 12), TypeError, "they lie on the processor"),
            (np.zeros((4, 12), np.float32), TypeError, "they lie on the processor"),
            (torch.zeros(4, 11, device="cuda"), ValueError, r"shape \(4, 11\); needed: \(4, 12\)"),
            (torch.zeros(12, 4, device="cuda").T, ValueError, "one block of memory"),
            (torch.zeros(4, 12, device="cuda", dtype=torch.float64), TypeError, "of 64 bits"),
            (torch.zeros(4, 12, device="cuda", dtype=torch.float16), TypeError, "of 16 bits"),
            ([[0.0] * 12] * 4, TypeError, "they are a list"),
            (torch.zeros(4, 12, device="cuda", requires_grad=True), (BufferError, RuntimeError), "grad"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                robots.step(actions)
        np.testing.assert_array_equal(robots.observation.numpy(), before)
        array = robots.observation
        self.assertEqual((array.shape, array.dtype, array.device), (before.shape, "float32", "cuda:0"))
        self.assertEqual(array.__dlpack_device__(), (CUDA, 0))
        with self.assertRaisesRegex(TypeError, r"numpy\(\)"):
            np.asarray(array)
        for named, error in (({"stream": 0}, ValueError), ({"copy": True}, BufferError), ({"dl_device": (CPU, 0)}, BufferError)):
            with self.subTest(named=named), self.assertRaises(error):
                array.__dlpack__(**named)
        for stream in (None, -1, 1, 2, torch.cuda.Stream().cuda_stream):
            array.__dlpack__(stream=stream, max_version=(1, 0))
        for settings in ({"task.self_contact": "limbs"}, {"task.terrain.levels": 4, "task.terrain.columns": 2}):
            with self.subTest(settings=settings):
                others = gaitfit.Robots(num_envs=4, device="cuda", settings=settings)
                others.step(torch.zeros(4, 12, device="cuda"))
                self.assertTrue(np.isfinite(others.observation.numpy()).all())

    def test_a_robot_that_diverges_has_fallen_unless_they_are_many(self) -> None:
        torch, count = self.torch, 300
        robots = gaitfit.Robots(num_envs=count, seed=1, device="cuda")
        actions = torch.zeros(count, 12, device="cuda")
        # The reward for smooth actions overflows.
        actions[[7, 270]] = 1e30
        self.assertGreaterEqual(robots.step(actions), 2)
        self.assertEqual(robots.diverged, 2)
        self.assertTrue(robots.terminated.numpy()[[7, 270]].all())
        np.testing.assert_array_equal(robots.last_observation.numpy()[[7, 270]], 0.0)
        self.assertTrue(np.isfinite(robots.observation.numpy()).all())
        actions[1:13] = 1e30
        with self.assertRaisesRegex(gaitfit.GaitfitError, "13 of 300 robots diverged, the first of them robot 1"):
            robots.step(actions)

    def test_a_state_is_taken_up_again_to_the_same_bits(self) -> None:
        torch, count = self.torch, 300
        terms: list[dict[str, Any]] = [{"quantity": name} for name in ("projected_gravity", "command", "last_action")]
        frames = {"task.policy.observation": [{"quantity": "joint_position", "history": 3}, *terms]}
        for settings in ({}, {"task.terrain.levels": 4, "task.terrain.columns": 2}, frames):
            with self.subTest(settings=settings):
                common: dict[str, Any] = {"num_envs": count, "seed": 4, "settings": {"task.episode_seconds": 0.6, **settings}}
                robots = gaitfit.Robots(**common, device="cuda")
                # A view of the commands is written from the processor, too.
                commands = torch.from_dlpack(robots.commands)
                actions = [torch.from_numpy(action).cuda() for action in self.actions(count, 50)]
                for action in actions[:20]:
                    robots.step(action)
                state, names = robots.state(), ("observation", "critic_observation", "reward", "terminated", "truncated")
                seen, asked = robots.observation.numpy(), commands.cpu().numpy()

                def walk() -> list[Any]:
                    found = []
                    for action in actions[20:]:
                        robots.step(action)
                        found.append([getattr(robots, name).numpy() for name in names] + [commands.cpu().numpy()])
                    return found

                first = walk()
                robots.set_state(state)
                np.testing.assert_array_equal(robots.observation.numpy(), seen)
                np.testing.assert_array_equal(commands.cpu().numpy(), asked)
                for step, (one, other) in enumerate(zip(first, walk())):
                    for name, *pair in zip([*names, "commands"], one, other):
                        np.testing.assert_array_equal(*pair, err_msg=f"{name}, step {step}")
                # The processor's robots take it up, and go the same way up to rounding.
                cpu = gaitfit.Robots(**common)
                cpu.set_state(state)
                self.assertLess(np.abs(cpu.observation - seen).max(), 1e-5)
                np.testing.assert_array_equal(cpu.commands, asked)
                cpu.step(actions[20].cpu().numpy())
                self.assertLess(np.median(np.abs(cpu.observation - first[0][0]).max(1)), 5e-3)
                other = cpu.state()
                robots.set_state(other)
                self.assertLess(np.abs(robots.observation.numpy() - cpu.observation).max(), 1e-5)
                if settings is not frames:  # The oldest frame is gone on a GPU; nothing reads it.
                    np.testing.assert_array_equal(robots.state().numbers, other.numbers)

    def test_commands_are_set(self) -> None:
        torch = self.torch
        cpu, gpu = (gaitfit.Robots(num_envs=300, seed=4, device=device) for device in ("cpu", "cuda"))
        action = self.actions(300, 1)[0]
        for robots in (cpu, gpu):
            robots.commands = [0.5, 0.0, 0.25]
        np.testing.assert_array_equal(torch.from_dlpack(gpu.commands).cpu(), cpu.commands)
        self.assertLess(np.abs(gpu.observation.numpy() - cpu.observation).max(), 1e-5)
        cpu.step(action)
        gpu.step(torch.from_numpy(action).cuda())
        self.assertLess(np.median(np.abs(gpu.observation.numpy() - cpu.observation).max(1)), 5e-3)
        self.assertEqual(gaitfit.Robots(num_envs=2, device="auto").device, "cuda:0")

    def test_reward_terms_motion_and_pictures(self) -> None:
        torch, count = self.torch, 300
        cpu, gpu = (gaitfit.Robots(num_envs=count, seed=4, device=device) for device in ("cpu", "cuda"))
        rewards = []
        for action in self.actions(count, 3):
            cpu.step(action)
            gpu.step(torch.from_numpy(action).cuda())
            rewards.append(gpu.reward.numpy().mean())
        terms, others = gpu.reward_terms(), cpu.reward_terms()
        self.assertEqual(list(terms), gpu.reward_names)
        self.assertAlmostEqual(sum(terms.values()), float(np.mean(rewards)), places=5)
        for name, value in terms.items():
            self.assertAlmostEqual(value, others[name], delta=1e-3 + 0.02 * abs(others[name]), msg=name)
        self.assertEqual(set(gpu.reward_terms().values()), {0.0}, "nothing was stepped since")
        for name in ("base_position", "base_quaternion", "joint_position"):
            apart = np.abs(getattr(gpu.motion(), name) - getattr(cpu.motion(), name)).max(1)
            self.assertLess(np.median(apart), 1e-3, name)
        self.assertLess(np.median(np.abs(gpu.motion().torque - cpu.motion().torque).max(1)), 0.5)
        self.assertEqual(gpu.picture(7).shape, (360, 480, 3))
        different = (gpu.picture(7) != cpu.picture(7)).mean()
        self.assertLess(different, 0.02)

    def test_gymnasium(self) -> None:
        torch = self.torch
        try:
            from gaitfit.gym import GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        env = GaitfitVecEnv(num_envs=32, device="cuda")
        first, infos = env.reset(seed=3)
        before, ends = first.numpy(), 0
        for _ in range(150):
            observation, reward, terminated, truncated, infos = env.step(torch.full((32, 12), 6.0, device="cuda"))
            if "final_obs" in infos:
                ends += infos["_final_obs"].numpy().sum()
        self.assertGreater(ends, 0)
        self.assertTrue(torch.isfinite(torch.from_dlpack(observation)).all())
        np.testing.assert_array_equal(env.reset(seed=3)[0].numpy(), before)
        with self.assertRaisesRegex(ValueError, "give copy=False"):
            GaitfitVecEnv(num_envs=4, device="cuda", copy=True)

    def test_rsl_rl(self) -> None:
        torch = self.torch
        try:
            from gaitfit.rsl_rl import RslRlVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        env = RslRlVecEnv(num_envs=32, device="cuda")
        observations = env.get_observations()
        kept = observations["policy"].clone()
        found, reward, dones, extras = env.step(torch.zeros(32, env.num_actions, device="cuda"))
        self.assertEqual((found["policy"].shape, reward.shape, dones.dtype), (kept.shape, (32,), torch.long))
        self.assertTrue(found["policy"].is_cuda and extras["time_outs"].is_cuda)
        self.assertEqual(set(extras["log"]), {f"/reward/{name}" for name in env.robots.reward_names})
        self.assertTrue(torch.equal(observations["policy"], kept), "what was handed out is not written over")


if __name__ == "__main__":
    unittest.main()
