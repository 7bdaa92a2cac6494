"""Makes policies that are no plain perceptrons, for the tests of gaitfit's reader, in
crates/gaitfit-policy-files/tests/fixtures/policies/graphs. Each has a TOML file that describes it, and observations with onnxruntime's
actions along a sequence.

The architectures are written anew from their papers and public code, with small layers and random weights:
him.onnx (HIMLoco: an estimator of velocity and normalised latent on a history, the newest frame first), dreamwaq.onnx (DreamWaQ: a
context encoder with means and variances, of which the means are used; two inputs), wtw.onnx (walk-these-ways: adaptation module
and body in one file), rma.onnx (RMA: convolutions along the history), moe.onnx (experts weighted by a softmax), estimator.onnx (a
GRU that estimates the velocity beside the actor, with its state as input and output), bounds.onnx (a clipped observation, and actions
clipped unevenly). operators.onnx has the operators that these lack, each in a branch of its own. Names that end in _old are
written by PyTorch's exporter before version 2.9.

Usage: .venv/bin/python tools/make_graph_fixtures.py [--out FOLDER]
Needs PyTorch: tools/setup_venv.sh --torch
"""

import argparse
import pathlib

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

import make_export_fixtures as exported
import make_policy_fixtures as fixtures

WIDTH, JOINTS, STEPS = fixtures.WIDTH, fixtures.JOINTS, 6


def perceptron(*widths, last=False):
    parts = []
    for inputs, outputs in zip(widths, widths[1:]):
        parts += [nn.Linear(inputs, outputs), nn.ELU()]
    return nn.Sequential(*(parts if last else parts[:-1]))


class Him(nn.Module):
    """Long et al. 2024: the exporter's forward takes the history alone, whose first frame is the present one."""

    frames, order = 6, "newest_first"

    def __init__(self):
        super().__init__()
        self.estimator = perceptron(self.frames * WIDTH, 16, 3 + 6)
        self.actor = perceptron(WIDTH + 3 + 6, 16, JOINTS)

    def forward(self, obs_history):
        parts = self.estimator(obs_history)
        velocity, latent = parts[..., :3], parts[..., 3:]
        latent = nn.functional.normalize(latent, dim=-1, p=2.0)
        return self.actor(torch.cat((obs_history[:, :WIDTH], velocity, latent), dim=1))


class Dreamwaq(nn.Module):
    """Nahrendra, Yu, Myung 2023: the actor sees the present observation, the estimated velocity and the mean of the code."""

    frames, order = 5, "frames"

    def __init__(self):
        super().__init__()
        self.encoder = perceptron(self.frames * WIDTH, 16, 8, last=True)
        self.velocity_mean, self.velocity_variance = nn.Linear(8, 3), nn.Linear(8, 3)
        self.code_mean, self.code_variance = nn.Linear(8, 6), nn.Linear(8, 6)
        self.actor = perceptron(WIDTH + 3 + 6, 16, JOINTS)

    def forward(self, obs, obs_history):
        hidden = self.encoder(obs_history)
        return self.actor(torch.cat((self.velocity_mean(hidden), self.code_mean(hidden), obs), dim=-1))


class Wtw(nn.Module):
    """Margolis, Agrawal 2022: the body sees the whole history and the estimated latent."""

    frames, order = 4, "frames"

    def __init__(self):
        super().__init__()
        self.adaptation_module = perceptron(self.frames * WIDTH, 16, 2)
        self.body = perceptron(self.frames * WIDTH + 2, 16, JOINTS)

    def forward(self, obs_history):
        return self.body(torch.cat((obs_history, self.adaptation_module(obs_history)), dim=-1))


class Rma(nn.Module):
    """Kumar et al. 2021: each frame is embedded, then convolutions run along the history."""

    frames, order = 10, "frames"

    def __init__(self):
        super().__init__()
        self.embed = nn.Sequential(nn.Linear(WIDTH, 8), nn.LeakyReLU())
        self.along = nn.Sequential(
            nn.Conv1d(8, 8, kernel_size=4, stride=2, padding=1),
            nn.LeakyReLU(),
            nn.Conv1d(8, 6, kernel_size=2, dilation=2, groups=2),
            nn.LeakyReLU(),
            nn.Flatten(),
        )
        self.latent = nn.Linear(6 * 3, 8)
        self.actor = perceptron(WIDTH + 8, 16, JOINTS)

    def forward(self, obs, obs_history):
        frames = self.embed(obs_history.reshape(-1, self.frames, WIDTH))
        return self.actor(torch.cat((obs, self.latent(self.along(frames.permute(0, 2, 1)))), dim=-1))


class Moe(nn.Module):
    """Experts whose actions are mixed by the weights of a gate, behind a layer norm with its parts."""

    frames, order = 1, "terms"

    def __init__(self):
        super().__init__()
        self.norm = nn.LayerNorm(WIDTH)
        self.gate = nn.Linear(WIDTH, 3)
        self.experts = nn.ModuleList([perceptron(WIDTH, 8, JOINTS) for _ in range(3)])

    def forward(self, obs):
        obs = self.norm(obs)
        weights = torch.softmax(self.gate(obs), dim=-1)
        actions = torch.stack([expert(obs) for expert in self.experts], dim=1)
        return torch.tanh(torch.bmm(weights.unsqueeze(1), actions).squeeze(1)) * torch.linspace(0.5, 2.0, JOINTS)


class Estimator(nn.Module):
    """A memory that estimates the velocity, beside an actor without one."""

    frames, order = 1, "terms"

    def __init__(self):
        super().__init__()
        self.rnn = nn.GRU(WIDTH, 8)
        self.velocity = nn.Linear(8, 3)
        self.actor = perceptron(WIDTH + 3, 16, JOINTS)

    def forward(self, obs, h_in):
        x, h_out = self.rnn(obs.unsqueeze(0), h_in)
        velocity = self.velocity(x.squeeze(0))
        return self.actor(torch.cat((obs, velocity), dim=-1)), h_out, velocity


class Bounds(nn.Module):
    frames, order = 1, "terms"

    def __init__(self):
        super().__init__()
        self.actor = perceptron(WIDTH, 16, JOINTS)
        self.actor[2].weight.data *= 3.0

    def forward(self, obs):
        return torch.clamp(self.actor(torch.clamp(obs, -1.0, 1.5)), -0.5, 1.0)


MODULES = {
    "him": Him,
    "dreamwaq": Dreamwaq,
    "wtw": Wtw,
    "rma": Rma,
    "moe": Moe,
    "estimator": Estimator,
    "bounds": Bounds,
}
# With the exporter of before, whose graphs have other operators.
OLD = ["him", "rma", "estimator"]


def describe(out, name, module):
    fixtures.describe(out, name, f"{name}.onnx")
    path = out / f"{name}.toml"
    text = path.read_text().replace("make_policy_fixtures", "make_graph_fixtures")
    if module.frames > 1:
        head, terms = text.split("observation = [")
        head += f'history = {{ order = "{module.order}" }}\n'
        text = head + "observation = [" + terms.replace(" }", f", history = {module.frames} }}")
    path.write_text(text)


# Branches of operators.onnx: nodes on `obs` (1 × 45), `rows` (1 × 9 × 5) and `square` (1 × 3 × 3 × 5), the last of which gives
# `out`. Constants are lists of whole numbers or floats.
BRANCHES = {
    "sums": [
        ("ReduceSum", ["rows", [1]], ["a"], {"keepdims": 0}),
        ("ReduceMax", ["rows", [-1]], ["b"], {"keepdims": 0}),
        ("ReduceMin", ["rows", [2]], ["c"], {"keepdims": 0}),
        ("Concat", ["a", "b", "c"], ["out"], {"axis": 1}),
    ],
    "lengths": [
        ("ReduceL1", ["rows", [2]], ["a"], {"keepdims": 1}),
        ("ReduceSumSquare", ["rows", [1]], ["b"], {"keepdims": 1}),
        ("ReduceMean", ["rows", [0, 1]], ["c"], {"keepdims": 0}),
        ("Flatten", ["a"], ["d"], {}),
        ("Squeeze", ["b", [1]], ["e"], {}),
        ("Unsqueeze", ["c", [0]], ["f"], {}),
        ("Concat", ["d", "e", "f"], ["out"], {"axis": -1}),
    ],
    "normal": [
        ("LpNormalization", ["rows"], ["a"], {"axis": 1, "p": 2}),
        ("LpNormalization", ["rows"], ["b"], {"axis": -1, "p": 1}),
        ("Add", ["a", "b"], ["out"], {}),
    ],
    "soft": [
        ("Softmax", ["rows"], ["a"], {"axis": 1}),
        ("LogSoftmax", ["rows"], ["b"], {"axis": 2}),
        ("Mul", ["a", "b"], ["out"], {}),
    ],
    "choice": [
        ("Greater", ["obs", [0.25]], ["a"], {}),
        ("LessOrEqual", ["obs", [1.0]], ["b"], {}),
        ("And", ["a", "b"], ["c"], {}),
        ("Not", ["a"], ["d"], {}),
        ("Abs", ["obs"], ["e"], {}),
        ("Sqrt", ["e"], ["f"], {}),
        ("Pow", ["obs", [3.0]], ["g"], {}),
        ("Where", ["c", "f", "g"], ["h"], {}),
        ("Where", ["d", "obs", "h"], ["out"], {}),
    ],
    "functions": [
        ("Exp", ["obs"], ["a"], {}),
        ("Softplus", ["obs"], ["b"], {}),
        ("Sigmoid", ["obs"], ["c"], {}),
        ("Erf", ["obs"], ["d"], {}),
        ("Sin", ["obs"], ["e"], {}),
        ("Cos", ["obs"], ["f"], {}),
        ("Mish", ["obs"], ["g"], {}),
        ("HardSwish", ["obs"], ["h"], {}),
        ("HardSigmoid", ["obs"], ["i"], {"alpha": 0.3}),
        ("Softsign", ["obs"], ["j"], {}),
        ("Neg", ["obs"], ["k"], {}),
        ("Reciprocal", ["a"], ["l"], {}),
        ("Log", ["b"], ["m"], {}),
        ("Sign", ["obs"], ["n"], {}),
        ("Floor", ["obs"], ["o"], {}),
        ("Gelu", ["obs"], ["p"], {"approximate": "tanh"}),
        ("Selu", ["obs"], ["q"], {}),
        ("PRelu", ["obs", [0.3]], ["r"], {}),
        ("Sum", list("abcdefgh"), ["s"], {}),
        ("Sum", ["s", *"ijklmnopqr"], ["out"], {}),
    ],
    "cuts": [
        ("Split", ["rows"], ["a", "b", "c"], {"axis": 1, "num_outputs": 3}),
        ("Transpose", ["b"], ["d"], {"perm": [0, 2, 1]}),
        ("Slice", ["d", [0], [5], [1], [2]], ["e"], {}),
        ("Gather", ["a", [2, 0]], ["f"], {"axis": 1}),
        ("Reshape", ["f", [0, -1]], ["g"], {}),
        ("Slice", ["c", [-1], [-1000], [2], [-1]], ["h"], {}),
        ("Flatten", ["e"], ["i"], {}),
        ("Flatten", ["h"], ["j"], {}),
        ("Gather", ["obs", 7], ["k"], {"axis": 1}),
        ("Unsqueeze", ["k", [1]], ["l"], {}),
        ("Expand", ["l", [1, 4]], ["m"], {}),
        ("Concat", ["g", "i", "j", "m"], ["out"], {"axis": 1}),
    ],
    "shape": [
        ("Shape", ["rows"], ["a"], {}),
        ("Gather", ["a", [2]], ["b"], {"axis": 0}),
        ("Concat", [[1], [-1], "b"], ["c"], {"axis": 0}),
        ("Reshape", ["obs", "c"], ["d"], {}),
        ("Max", ["d", [-0.5]], ["e"], {}),
        ("Min", ["e", "rows", [0.75]], ["out"], {}),
    ],
    "products": [
        ("Transpose", ["rows"], ["a"], {"perm": [0, 2, 1]}),
        ("MatMul", ["rows", "a"], ["b"], {}),
        ("MatMul", ["@5x9", "b"], ["c"], {}),
        ("MatMul", ["c", "@9x2"], ["out"], {}),
    ],
    "picture": [
        ("Transpose", ["square"], ["a"], {"perm": [0, 3, 1, 2]}),
        ("Conv", ["a", "@4x5x2x2", "@4"], ["b"], {"strides": [2, 1], "auto_pad": "SAME_UPPER"}),
        ("BatchNormalization", ["b", "@4", "@4", "@4", "+4"], ["c"], {}),
        ("GlobalAveragePool", ["c"], ["d"], {}),
        ("Concat", ["c", "c"], ["e"], {"axis": 2}),
        ("Flatten", ["d"], ["f"], {}),
        ("Flatten", ["e"], ["g"], {}),
        ("Concat", ["f", "g"], ["out"], {"axis": 1}),
    ],
    "layers": [
        ("LayerNormalization", ["rows", "@9x5"], ["a"], {"axis": 1}),
        ("LSTM", ["times", "@1x12x5", "@1x12x3", "@1x24"], ["b", "c", "d"], {"hidden_size": 3}),
        ("Flatten", ["a"], ["e"], {}),
        ("Reshape", ["b", [1, -1]], ["f"], {}),
        ("Squeeze", ["c", [0]], ["g"], {}),
        ("Squeeze", ["d", [0]], ["h"], {}),
        ("Concat", ["e", "f", "g", "h"], ["out"], {"axis": 1}),
    ],
}


def operators(path, branches):
    """A graph of these branches, whose numbers a last layer mixes into actions."""
    rng, nodes, constants, ends = np.random.default_rng(3), [], [], []
    numbered = iter(range(10_000))

    def constant(value):
        name = f"constant_{next(numbered)}"
        if isinstance(value, str):
            value_of = rng.uniform(0.5, 2.0, [int(x) for x in value[1:].split("x")]) * (1 if value[0] == "+" else 0.4)
            value = (value_of if value[0] == "+" else value_of - 0.5).astype(np.float32)
        elif isinstance(value, int) or all(isinstance(x, int) for x in value):
            value = np.array(value, np.int64)
        else:
            value = np.array(value, np.float32)
        constants.append(numpy_helper.from_array(value, name))
        return name

    for shape, name in (([1, 9, 5], "rows"), ([1, 3, 3, 5], "square"), ([9, 1, 5], "times")):
        nodes.append(helper.make_node("Reshape", ["obs", constant(shape)], [name]))
    for branch, lines in branches.items():
        for operator, inputs, outputs, attributes in lines:
            named = []
            for one in inputs:
                if isinstance(one, str) and one[0] not in "@+":
                    named.append(one if one in ("obs", "rows", "square", "times") else f"{branch}_{one}")
                else:
                    named.append(constant(one))
            nodes.append(helper.make_node(operator, named, [f"{branch}_{one}" for one in outputs], **attributes))
        nodes.append(helper.make_node("Reshape", [f"{branch}_out", constant([1, -1])], [f"{branch}_row"]))
        ends.append(f"{branch}_row")
    nodes.append(helper.make_node("Concat", ends, ["all"], axis=1))
    shapes = onnx.shape_inference.infer_shapes(
        helper.make_model(helper.make_graph(nodes, "widths", [end("obs", WIDTH)], [], constants)), data_prop=True
    )
    width = next(x for x in shapes.graph.value_info if x.name == "all").type.tensor_type.shape.dim[1].dim_value
    constants.append(numpy_helper.from_array((rng.normal(0, width**-0.5, (width, JOINTS))).astype(np.float32), "mix"))
    nodes.append(helper.make_node("Gemm", ["all", "mix"], ["actions"]))
    graph = helper.make_graph(nodes, "operators", [end("obs", WIDTH)], [end("actions", JOINTS)], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 22)], ir_version=10)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def end(name, width):
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, width])


def operator_fixture(out, stem, branches):
    path = out / f"{stem}.onnx"
    operators(path, branches)
    observation, run = exported.rows(5, STEPS), exported.session(path)
    exported.save(out, stem, observation, [run.run(None, {"obs": row[None]})[0][0] for row in observation])
    describe(out, stem, Moe)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = fixtures.ROOT / "crates/gaitfit-policy-files/tests/fixtures/policies/graphs"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    parser.add_argument("--all", action="store_true", help="all modules with both exporters, and each branch alone")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    operator_fixture(args.out, "operators", BRANCHES)
    for branch in BRANCHES if args.all else []:
        operator_fixture(args.out, f"operators_{branch}", {branch: BRANCHES[branch]})
    for number, (name, kind) in enumerate(MODULES.items()):
        torch.manual_seed(number)
        module = kind().eval()
        takes = {"obs": torch.zeros(1, WIDTH)}
        if module.frames > 1:
            takes["obs_history"] = torch.zeros(1, module.frames * WIDTH)
            if name in ("him", "wtw"):
                del takes["obs"]
        outputs = ["actions"]
        if name == "estimator":
            takes["h_in"] = torch.zeros(1, 1, 8)
            outputs += ["h_out", "velocity"]
        observation = np.random.default_rng(number).normal(0, 1, (STEPS, module.frames * WIDTH))
        observation = np.round(observation, 2).astype(np.float32)
        for old in [False, True] if name in OLD or args.all else [False]:
            stem = f"{name}_old" if old else name
            path = args.out / f"{stem}.onnx"
            ends = {"input_names": list(takes), "output_names": outputs}
            example = tuple(takes.values())
            if old:
                torch.onnx.export(module, example, str(path), opset_version=11, dynamo=False, **ends)
            else:
                torch.onnx.export(module, example, str(path), external_data=False, **ends)
            exported.without_paths(path)
            run, memory, actions = exported.session(path), takes.get("h_in"), []
            memory = None if memory is None else memory.numpy()
            for row in observation:
                present = row[:WIDTH] if module.order == "newest_first" else row[-WIDTH:]
                given = {"obs": present[None], "obs_history": row[None], "h_in": memory}
                found = run.run(None, {key: given[key] for key in takes})
                memory = found[1] if name == "estimator" else None
                actions.append(found[0][0])
            exported.save(args.out, stem, observation, actions)
            describe(args.out, stem, module)


if __name__ == "__main__":
    main()
