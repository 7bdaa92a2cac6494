"""Makes policies "trained elsewhere" for the tests of gaitfit's importer, in crates/gaitfit-policy/tests/fixtures/policies.

foreign.onnx is built with the onnx package out of every form of a linear layer that exporters write, behind a normaliser of
Sub, Add and Div; its outputs are onnxruntime's. trainer.safetensors has the tensors of a usual PyTorch trainer
(nn.Sequential, a normaliser module, std); its outputs are computed here in double precision. Random weights, seeded: the
same packages give the same bytes.

Usage: .venv/bin/python tools/make_policy_fixtures.py [--out FOLDER]
"""

import argparse
import json
import pathlib

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

ROOT = pathlib.Path(__file__).parent.parent
WIDTH, JOINTS, ROWS = 45, 12, 5
# All hips, then thighs, then calves: not the order of the robot file.
NAMES = [f"{leg}_{kind}_joint" for kind in ("hip", "thigh", "calf") for leg in ("FL", "FR", "RL", "RR")]
POSE = [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]
DESCRIPTION = """# Made by tools/make_policy_fixtures.py.
file = "{file}"
{more}robot = "go2"
joints = {joints}
default_pose = {pose}
action_scale = 0.25
kp = 25
kd = 0.5
control_dt = 0.02
observation = [
    {{ quantity = "base_angular_velocity", scale = 0.25 }},
    {{ quantity = "projected_gravity" }},
    {{ quantity = "command", scale = [2.0, 2.0, 0.25] }},
    {{ quantity = "joint_position" }},
    {{ quantity = "joint_velocity", scale = 0.05 }},
    {{ quantity = "last_action" }},
]
"""


def layer(rng, inputs, outputs):
    """Weight, outputs × inputs, and bias of a layer, as PyTorch keeps them."""
    bound = inputs**-0.5
    return (
        rng.uniform(-bound, bound, (outputs, inputs)).astype(np.float32),
        rng.uniform(-bound, bound, outputs).astype(np.float32),
    )


def describe(out, stem, file, more=""):
    text = DESCRIPTION.format(file=file, more=more, joints=json.dumps(NAMES), pose=json.dumps(POSE))
    (out / f"{stem}.toml").write_text(text)


def save_rows(out, stem, rows, actions):
    table = {"observation": np.asarray(rows, np.float32).tolist(), "actions": np.asarray(actions, np.float64).tolist()}
    (out / f"{stem}_rows.json").write_text(json.dumps(table) + "\n")


def foreign_onnx(out, rng):
    (w0, b0), (w1, b1), (w2, _) = layer(rng, WIDTH, 16), layer(rng, 16, 8), layer(rng, 8, JOINTS)
    mean, std = rng.normal(0, 0.5, (1, WIDTH)), rng.uniform(0.03, 2, (1, WIDTH))
    constants = {"mean": mean, "std": std, "eps": 0.01, "w0": w0, "b0": b0 / 2, "w1": w1, "b1": b1[None], "w2": w2.T}
    initializers = [numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in constants.items()]
    # One tensor in the container that is not raw bytes.
    initializers[4] = helper.make_tensor("b0", TensorProto.FLOAT, [16], (b0 / 2).tolist())
    shape = helper.make_tensor("shape", TensorProto.INT64, [2], [-1, 16])
    node = helper.make_node
    nodes = [
        node("Add", ["std", "eps"], ["divisor"]),
        node("Sub", ["obs", "mean"], ["centred"]),
        node("Div", ["centred", "divisor"], ["normal"]),
        node("Gemm", ["normal", "w0", "b0"], ["h0"], transB=1, alpha=0.5, beta=2.0),
        node("Elu", ["h0"], ["a0"], alpha=1.0),
        node("Constant", [], ["shape"], value=shape),
        node("Reshape", ["a0", "shape"], ["r0"]),
        node("Transpose", ["w1"], ["w1t"], perm=[1, 0]),
        node("MatMul", ["r0", "w1t"], ["m1"]),
        node("Add", ["b1", "m1"], ["h1"]),
        node("Elu", ["h1"], ["a1"]),
        node("Flatten", ["a1"], ["f1"]),
        node("Gemm", ["f1", "w2"], ["h2"]),
        node("Identity", ["h2"], ["actions"]),
    ]
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])
        for name, width in (("obs", WIDTH), ("actions", JOINTS))
    ]
    graph = helper.make_graph(nodes, "foreign", ends[:1], ends[1:], initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path = out / "foreign.onnx"
    onnx.save(model, path)
    rows = rng.normal(0, 1, (ROWS, WIDTH)).astype(np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    save_rows(out, "foreign", rows, session.run(None, {"obs": rows})[0])
    describe(out, "foreign", path.name)


def trainer_safetensors(out, rng):
    tensors, x = {}, rng.normal(0, 1, (ROWS, WIDTH)).astype(np.float32)
    rows = x
    mean, std = rng.normal(0, 0.5, (1, WIDTH)).astype(np.float32), rng.uniform(0.03, 2, (1, WIDTH)).astype(np.float32)
    tensors["actor_obs_normalizer._mean"], tensors["actor_obs_normalizer._std"] = mean, std
    x = (x.astype(float) - mean) / (std.astype(float) + 0.01)
    for number, (inputs, outputs) in zip((0, 2, 4), ((WIDTH, 16), (16, 8), (8, JOINTS))):
        weight, bias = layer(rng, inputs, outputs)
        tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"] = weight, bias
        x = (x if number == 0 else np.tanh(x)) @ weight.T.astype(float) + bias
    tensors["std"] = np.linspace(0.2, 0.8, JOINTS, dtype=np.float32)
    header, data = {}, b""
    for name, tensor in tensors.items():
        end = len(data) + tensor.nbytes
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(data), end]}
        data += tensor.tobytes()
    text = json.dumps(header).encode()
    (out / "trainer.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + data)
    save_rows(out, "trainer", rows, x)
    more = 'activation = "tanh"\nnormaliser = { mean = "actor_obs_normalizer._mean", std = "actor_obs_normalizer._std" }\n'
    describe(out, "trainer", "trainer.safetensors", more)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    default = ROOT / "crates/gaitfit-policy/tests/fixtures/policies"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(45)
    foreign_onnx(out, rng)
    trainer_safetensors(out, rng)


if __name__ == "__main__":
    main()
