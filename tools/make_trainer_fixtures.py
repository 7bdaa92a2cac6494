"""Makes policies with the trainers' own libraries, exported as their users export them, for the tests of gaitfit's reader, in
crates/gaitfit-policy-files/tests/fixtures/policies/trainers. Each has observations with the actions of the library itself along a
sequence, and a TOML file that describes it, except mjlab.onnx, whose metadata do.

rsl_rl.onnx, rsl_rl_two.onnx (a standard deviation that depends on the state), rsl_rl_beta.onnx and rsl_rl_gru.onnx are exported as
RSL-RL's runner does; mjlab.onnx is such a file with the metadata that mjlab 1.6 attaches: scales, histories and clips of the terms.
sb3_ppo.onnx and sb3_sac.onnx follow Stable-Baselines3's documentation. skrl.onnx is a skrl model behind its preprocessor, which
clips the observation. brax.onnx is the graph that MuJoCo Playground's notebook makes with TensorFlow and tf2onnx, written here
operator by operator; brax.safetensors comes from the same parameters with the lines of docs/policies-convert.md. Small layers,
random weights, seeded.

Usage: .venv/bin/python tools/make_trainer_fixtures.py [--out FOLDER]
Needs PyTorch (tools/setup_venv.sh --torch), skrl 2.1 and brax 0.14
"""

import argparse
import pathlib

import gymnasium
import jax
import numpy as np
import onnx
import skrl.models.torch as skrl_models
import skrl.resources.preprocessors.torch as skrl_preprocessors
import torch
from brax.training.acme import running_statistics, specs
from brax.training.agents.ppo import networks as brax_networks
from onnx import TensorProto, helper, numpy_helper
from rsl_rl.models import MLPModel, RNNModel
from safetensors.numpy import save_file
from stable_baselines3 import PPO, SAC
from tensordict import TensorDict

import make_export_fixtures as exported
import make_policy_fixtures as fixtures

WIDTH, JOINTS, STEPS = fixtures.WIDTH, fixtures.JOINTS, 6
HISTORY = [3, 1, 1, 2, 1, 1]


def scramble(module, gain=1.0):
    """Random weights, larger than a fresh policy's."""
    with torch.no_grad():
        for values in module.parameters():
            if values.dim() > 1:
                values.copy_(torch.randn_like(values) * gain * values.shape[-1] ** -0.5)
            else:
                values.copy_(torch.randn_like(values) * 0.2)


def observations(seed, width=WIDTH):
    return np.round(np.random.default_rng(seed).normal(0, 1.5, (STEPS, width)), 2).astype(np.float32)


def rsl_rl(out, name, kind=MLPModel, distribution="GaussianDistribution", width=WIDTH, **options):
    torch.manual_seed(len(name))
    sample = TensorDict({"policy": torch.zeros(1, width)}, batch_size=[1])
    cfg = {"class_name": f"rsl_rl.modules.distribution:{distribution}"}
    model = kind(sample, {"actor": ["policy"]}, "actor", JOINTS, (16, 8), "elu", True, cfg, **options)
    scramble(model.mlp)
    with torch.no_grad():
        model.obs_normalizer._mean.uniform_(-0.5, 0.5)
        model.obs_normalizer._std.uniform_(0.3, 2.0)
    wrapped = model.as_onnx(verbose=False).eval()
    path = out / f"{name}.onnx"
    torch.onnx.export(
        wrapped,
        wrapped.get_dummy_inputs(),
        str(path),
        export_params=True,
        opset_version=18,
        verbose=False,
        input_names=wrapped.input_names,
        output_names=wrapped.output_names,
    )
    exported.without_paths(path)
    rows, memory, actions = observations(len(name), width), [], []
    memory = list(wrapped.get_dummy_inputs()[1:])
    with torch.no_grad():
        for row in rows:
            found = wrapped(torch.tensor(row[None]), *memory)
            if memory:
                found, *memory = found
                memory = [value for value in memory if value is not None]
            actions.append(found[0].numpy())
    exported.save(out, name, rows, actions)
    return path


def mjlab(out):
    """The metadata of mjlab 1.6's `get_base_metadata` for a policy with histories, as its exporter writes lists."""
    width = 3 * 3 + 3 + 3 + 2 * JOINTS + 2 * JOINTS
    path = rsl_rl(out, "mjlab", width=width)
    (out / "mjlab.toml").unlink()
    legs = [f"{leg}_{kind}_joint" for leg in ("FR", "FL", "RR", "RL") for kind in ("hip", "thigh", "calf")]
    scalar = lambda value: f"{value:.3f}" if isinstance(value, (int, float)) else str(value)
    entry = lambda value: ";".join(map(scalar, value)) if isinstance(value, (list, tuple)) else scalar(value)
    listed = lambda values: ",".join(map(entry, values))
    infinite = [float("-inf"), float("inf")]
    metadata = {
        "run_path": "local",
        "joint_names": listed(legs),
        "joint_stiffness": listed([20.0, 20.0, 40.0] * 4),
        "joint_damping": listed([1.0, 1.0, 2.0] * 4),
        "default_joint_pos": listed([0.1, 0.9, -1.8, -0.1, 0.9, -1.8] * 2),
        "command_names": "twist",
        "observation_names": "base_ang_vel,projected_gravity,command,joint_pos,joint_vel,actions",
        "observation_terms_scale": listed([0.25, 1.0, [2.0, 2.0, 0.25], 1.0, 0.05, 1.0]),
        "observation_terms_flatten_history_dim": listed([True] * 6),
        "observation_terms_history_length": ",".join(f"{length if length > 1 else 0:.3f}" for length in HISTORY),
        "observation_terms_clip": listed([infinite] * 4 + [[-100.0, 100.0], infinite]),
        "action_scale": "0.25",
    }
    model = onnx.load(path, load_external_data=False)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    path.write_bytes(model.SerializeToString())


class Walking(gymnasium.Env):
    """What SB3 needs to know of a task."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (WIDTH,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (JOINTS,), np.float32)


class Deterministic(torch.nn.Module):
    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, observation):
        return self.policy(observation, deterministic=True)


def sb3(out, name, kind, inner):
    torch.manual_seed(5)
    policy = kind("MlpPolicy", Walking(), policy_kwargs={"net_arch": [16, 8]}, device="cpu").policy
    scramble(policy)
    module = Deterministic(inner(policy)).eval()
    path = out / f"{name}.onnx"
    torch.onnx.export(module, (torch.zeros(1, WIDTH),), str(path), opset_version=17, input_names=["input"], dynamo=False)
    exported.without_paths(path)
    rows = observations(20)
    with torch.no_grad():
        actions = module(torch.tensor(rows))
    exported.save(out, name, rows, (actions[0] if isinstance(actions, tuple) else actions).numpy())


class SkrlPolicy(skrl_models.GaussianMixin, skrl_models.Model):
    def __init__(self):
        spaces = {"observation_space": Walking.observation_space, "action_space": Walking.action_space, "device": "cpu"}
        skrl_models.Model.__init__(self, **spaces)
        skrl_models.GaussianMixin.__init__(self, clip_actions=False)
        self.net = torch.nn.Sequential(torch.nn.Linear(WIDTH, 16), torch.nn.ELU(), torch.nn.Linear(16, JOINTS))
        self.log_std_parameter = torch.nn.Parameter(torch.zeros(JOINTS))

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {"log_std": self.log_std_parameter}


class SkrlExported(torch.nn.Module):
    def __init__(self, policy, preprocessor):
        super().__init__()
        self.policy, self.preprocessor = policy, preprocessor

    def forward(self, observations):
        return self.policy.compute({"observations": self.preprocessor(observations)}, "policy")[0]


def skrl(out):
    torch.manual_seed(6)
    scaler = skrl_preprocessors.RunningStandardScaler(size=Walking.observation_space, device="cpu")
    scaler.running_mean.uniform_(-0.5, 0.5)
    scaler.running_variance.uniform_(0.02, 0.5)
    policy = SkrlPolicy()
    scramble(policy)
    module = SkrlExported(policy, scaler).eval()
    path = out / "skrl.onnx"
    ends = {"input_names": ["obs"], "output_names": ["actions"]}
    torch.onnx.export(module, (torch.zeros(1, WIDTH),), str(path), external_data=False, **ends)
    exported.without_paths(path)
    rows = observations(21)
    with torch.no_grad():
        exported.save(out, "skrl", rows, module(torch.tensor(rows)).numpy())


def brax(out):
    networks = brax_networks.make_ppo_networks(
        WIDTH, JOINTS, preprocess_observations_fn=running_statistics.normalize, policy_hidden_layer_sizes=(16, 8)
    )
    rng = np.random.default_rng(30)
    policy = networks.policy_network.init(jax.random.PRNGKey(0))
    policy = jax.tree_util.tree_map(lambda x: np.asarray(x + 0.2 * rng.normal(size=x.shape), np.float32), policy)
    normaliser = running_statistics.init_state(specs.Array((WIDTH,), np.dtype("float32")))
    mean = rng.uniform(-0.5, 0.5, WIDTH).astype(np.float32)
    normaliser = normaliser.replace(mean=mean, std=rng.uniform(0.3, 2.0, WIDTH).astype(np.float32))
    params = (normaliser, policy, None)
    rows = observations(22)
    act = brax_networks.make_inference_fn(networks)((normaliser, policy), deterministic=True)
    actions = np.asarray(act(rows, jax.random.PRNGKey(0))[0])

    layers = params[1]["params"]
    tensors = {"mean": np.asarray(params[0].mean), "std": np.asarray(params[0].std)}
    for number in range(len(layers)):
        kernel, bias = (np.asarray(layers[f"hidden_{number}"][part]) for part in ("kernel", "bias"))
        if number + 1 == len(layers):  # the second half is the standard deviation
            kernel, bias = kernel[:, : kernel.shape[1] // 2], bias[: bias.size // 2]
        tensors[f"actor.{2 * number}.weight"], tensors[f"actor.{2 * number}.bias"] = kernel.T.copy(), bias.copy()
    save_file(tensors, str(out / "brax.safetensors"))
    more = 'activation = "swish"\noutput_activation = "tanh"\nnormaliser = { mean = "mean", std = "std", epsilon = 0.0 }\n'
    fixtures.describe(out, "brax_tensors", "brax.safetensors", more)

    constants = {"mean": tensors["mean"], "std": tensors["std"]}
    nodes = [helper.make_node("Sub", ["obs", "mean"], ["sub"]), helper.make_node("Div", ["sub", "std"], ["x0"])]
    for number in range(len(layers)):
        parts = [f"MLP_0/hidden_{number}/{part}" for part in ("kernel", "bias")]
        for part, name in zip(("kernel", "bias"), parts):
            constants[name] = np.asarray(layers[f"hidden_{number}"][part])
        product, total = f"m{number}", f"s{number}"
        nodes.append(helper.make_node("MatMul", [f"x{number}", parts[0]], [product]))
        nodes.append(helper.make_node("Add", [product, parts[1]], [total]))
        if number + 1 < len(layers):
            nodes.append(helper.make_node("Sigmoid", [total], [f"g{number}"]))
            nodes.append(helper.make_node("Mul", [total, f"g{number}"], [f"x{number + 1}"]))
    nodes.append(helper.make_node("Split", [total], ["loc", "scale"], axis=-1))
    nodes.append(helper.make_node("Tanh", ["loc"], ["continuous_actions"]))
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["unk__0", width])
        for name, width in (("obs", WIDTH), ("continuous_actions", JOINTS))
    ]
    initializers = [numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "tf2onnx", ends[:1], ends[1:], initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 11)], ir_version=6, producer_name="tf2onnx")
    onnx.checker.check_model(model)
    onnx.save(model, out / "brax.onnx")
    exported.save(out, "brax", rows, actions)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = fixtures.ROOT / "crates/gaitfit-policy-files/tests/fixtures/policies/trainers"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    rsl_rl(out, "rsl_rl")
    rsl_rl(out, "rsl_rl_two", distribution="HeteroscedasticGaussianDistribution")
    rsl_rl(out, "rsl_rl_beta", distribution="BetaDistribution")
    rsl_rl(out, "rsl_rl_gru", kind=RNNModel, rnn_type="gru", rnn_hidden_dim=8, rnn_num_layers=1)
    mjlab(out)
    sb3(out, "sb3_ppo", PPO, lambda policy: policy)
    sb3(out, "sb3_sac", SAC, lambda policy: policy.actor)
    skrl(out)
    brax(out)
    for path in out.glob("*.toml"):
        path.write_text(path.read_text().replace("make_policy_fixtures", "make_trainer_fixtures"))


if __name__ == "__main__":
    main()
