"""Makes policies "trained elsewhere" for the tests of gaitfit's importer, in crates/gaitfit-policy-files/tests/fixtures/policies.

foreign.onnx is built with the onnx package out of every form of a linear layer that exporters write, behind a normaliser of
Sub, Add and Div; its outputs are onnxruntime's. trainer.safetensors has the tensors of a usual PyTorch trainer
(nn.Sequential, a normaliser module, std); its outputs are computed here in double precision. mjlab.onnx has the graph and
the metadata of mjlab's exporter; unitree/ the folders of unitree_rl_lab, with a history of five frames; both know no TOML.
functions/ has
activations and layer norm as PyTorch's exporter writes them. lstm.onnx and gru.onnx are recurrent as rsl_rl's exporter writes them; their outputs are onnxruntime's along a sequence.
Random weights, seeded: the same packages give the same bytes.

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


def perceptron(layers, head, activation="Elu"):
    """Nodes and initializers of layers as PyTorch exports them; the last gives `actions`."""
    nodes, initializers = [], []
    for index, (weight, bias) in enumerate(layers):
        names = [f"mlp.{2 * index}.weight", f"mlp.{2 * index}.bias"]
        initializers += [numpy_helper.from_array(value, name) for name, value in zip(names, (weight, bias))]
        last = index + 1 == len(layers)
        out = "actions" if last else f"h{index}"
        nodes.append(helper.make_node("Gemm", [head, *names], [out], alpha=1.0, beta=1.0, transB=1))
        head = out
        if not last:
            nodes.append(helper.make_node(activation, [out], [f"a{index}"]))
            head = f"a{index}"
    return nodes, initializers


def save_graph(path, nodes, initializers, inputs, outputs, metadata=()):
    ends = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in ends] for ends in (inputs, outputs)
    ]
    graph = helper.make_graph(nodes, "main_graph", *ends, initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    for key, value in metadata:
        model.metadata_props.append(onnx.StringStringEntryProto(key=key, value=value))
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, path)
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def mjlab_onnx(out, rng):
    """As mjlab's velocity task on a Go2 would be exported: a normaliser, ELU, lists with three decimals."""
    width = 48
    mean, std = rng.normal(0, 0.5, (1, width)).astype(np.float32), rng.uniform(0.03, 2, (1, width)).astype(np.float32)
    normal = [helper.make_node("Sub", ["obs", "mean"], ["centred"]), helper.make_node("Div", ["centred", "std"], ["normal"])]
    nodes, initializers = perceptron([layer(rng, width, 16), layer(rng, 16, 8), layer(rng, 8, JOINTS)], "normal")
    initializers += [numpy_helper.from_array(mean, "mean"), numpy_helper.from_array(std + np.float32(0.01), "std")]
    listed = lambda values: ",".join(value if isinstance(value, str) else f"{value:.3f}" for value in values)
    legs = [f"{leg}_{kind}_joint" for leg in ("FR", "FL", "RR", "RL") for kind in ("hip", "thigh", "calf")]
    observed = ["base_lin_vel", "base_ang_vel", "projected_gravity", "joint_pos", "joint_vel", "actions", "command"]
    metadata = [
        ("run_path", "local"),
        ("joint_names", listed(legs)),
        ("joint_stiffness", listed([20.0, 20.0, 40.0] * 4)),
        ("joint_damping", listed([1.0, 1.0, 2.0] * 4)),
        ("default_joint_pos", listed([0.1, 0.9, -1.8, -0.1, 0.9, -1.8] * 2)),
        ("command_names", "twist"),
        ("observation_names", listed(observed)),
        ("action_scale", listed([0.373, 0.373, 0.249] * 4)),
    ]
    ends = [("obs", [1, width])], [("actions", [1, JOINTS])]
    session = save_graph(out / "mjlab.onnx", normal + nodes, initializers, *ends, metadata)
    rows = rng.normal(0, 1, (ROWS, width)).astype(np.float32)
    save_rows(out, "mjlab", rows, np.concatenate([session.run(None, {"obs": row[None]})[0] for row in rows]))


def motion_onnx(out, rng):
    """As mjlab's tracking task would be exported: the motion is in the graph, `time_step` chooses a row of it."""
    width, samples = 69, 5
    nodes, initializers = perceptron([layer(rng, width, 16), layer(rng, 16, JOINTS)], "obs")
    listed = lambda values: ",".join(value if isinstance(value, str) else f"{value:.3f}" for value in values)
    legs = [f"{leg}_{kind}_joint" for leg in ("FR", "FL", "RR", "RL") for kind in ("hip", "thigh", "calf")]
    ends = [("actions", [1, JOINTS])]
    nodes += [
        helper.make_node("Cast", ["time_step"], ["whole"], to=TensorProto.INT64),
        helper.make_node("Squeeze", ["whole", "last"], ["flat"]),
        helper.make_node("Min", ["flat", "end"], ["step"]),
    ]
    initializers += [numpy_helper.from_array(np.array(value), name) for name, value in (("last", [-1]), ("end", [samples - 1]))]
    for name in ("joint_pos", "joint_vel"):
        table = rng.normal(0, 1, (samples, JOINTS)).astype(np.float32)
        initializers.append(numpy_helper.from_array(table, f"{name}_table"))
        nodes.append(helper.make_node("Gather", [f"{name}_table", "step"], [name], axis=0))
        ends.append((name, [1, JOINTS]))
    metadata = [
        ("run_path", "local"),
        ("joint_names", listed(legs)),
        ("joint_stiffness", listed([20.0] * JOINTS)),
        ("joint_damping", listed([1.0] * JOINTS)),
        ("default_joint_pos", listed([0.1, 0.9, -1.8, -0.1, 0.9, -1.8] * 2)),
        ("command_names", "motion"),
        ("observation_names", "command,motion_anchor_ori_b,base_ang_vel,joint_pos,joint_vel,actions"),
        ("observation_terms_scale", ";".join(["0.5"] * JOINTS + ["2.0"] * JOINTS) + ",1.0,1.0,1.0,1.0,1.0"),
        ("observation_terms_history_length", "0,0,0,0,0,0"),
        ("action_scale", listed([0.25] * JOINTS)),
        ("anchor_body_name", "base"),
        ("body_names", "base,FL_calf"),
    ]
    session = save_graph(out / "mjlab_motion.onnx", nodes, initializers, [("obs", [1, width]), ("time_step", [1, 1])], ends, metadata)
    rows = rng.normal(0, 1, (ROWS, width)).astype(np.float32)
    step = np.zeros((1, 1), np.float32)
    actions = [session.run(["actions"], {"obs": row[None], "time_step": step})[0] for row in rows]
    save_rows(out, "mjlab_motion", rows, np.concatenate(actions))


def unitree_folders(out, rng):
    """As unitree_rl_lab leaves a Go2's velocity task: exported/policy.onnx and params/deploy.yaml."""
    width = 5 * WIDTH
    nodes, initializers = perceptron([layer(rng, width, 8), layer(rng, 8, JOINTS)], "obs")
    ends = [("obs", [1, width])], [("actions", [1, JOINTS])]
    save_graph(out / "unitree/exported/policy.onnx", nodes, initializers, *ends)
    sdk = [f"{leg}_{kind}_joint" for leg in ("FR", "FL", "RR", "RL") for kind in ("hip", "thigh", "calf")]
    term = "  {}:\n    params: {}\n    clip: null\n    scale: {}\n    history_length: 5\n"
    terms = [("base_ang_vel", 3, 0.2), ("projected_gravity", 3, 1.0), ("velocity_commands", 3, 1.0),
             ("joint_pos_rel", 12, 1.0), ("joint_vel_rel", 12, 0.05), ("last_action", 12, 1.0)]
    text = (
        "# Made by tools/make_policy_fixtures.py.\n"
        f"joint_ids_map: {[sdk.index(name) for name in NAMES]}\n"
        "step_dt: 0.02\n"
        f"stiffness: {[25.0, 25.0, 30.0] * 4}\n"
        f"damping: {[0.5] * 12}\n"
        f"default_joint_pos: {POSE}\n"
        "commands:\n  base_velocity:\n    ranges:\n      lin_vel_x: [-1.0, 1.0]\n      lin_vel_y: [-0.4, 0.4]\n"
        "      ang_vel_z: [-1.0, 1.0]\n      heading: null\n"
        "actions:\n  JointPositionAction:\n    clip: null\n    joint_names: [.*]\n"
        f"    scale: {[0.25] * 12}\n    offset: {POSE}\n"
        "    joint_ids: !!python/object/apply:builtins.slice [null, null, null]\n"
        "observations:\n" + "".join(term.format(name, "{}", [scale] * count) for name, count, scale in terms)
    )
    (out / "unitree/params").mkdir(parents=True, exist_ok=True)
    (out / "unitree/params/deploy.yaml").write_text(text)


def recurrent_onnx(out, rng, kind, hidden=12, depth=2):
    """As rsl_rl's exporter traces a recurrent actor: obs, h_in (and c_in) to actions, h_out (and c_out)."""
    gates = {"LSTM": 4, "GRU": 3}[kind]
    states = {"LSTM": ["h", "c"], "GRU": ["h"]}[kind]
    node = helper.make_node
    initializers = [
        numpy_helper.from_array(np.array([value], np.int64), name) for name, value in (("zero", 0), ("one", 1), ("two", 2))
    ]
    nodes, head = [node("Unsqueeze", ["obs", "zero"], ["x0"])], "x0"
    for number in range(depth):
        inputs, bound = (WIDTH if number == 0 else hidden), hidden**-0.5
        draw = lambda *shape: rng.uniform(-bound, bound, shape).astype(np.float32)
        parts = {"W": draw(1, gates * hidden, inputs), "R": draw(1, gates * hidden, hidden), "B": draw(1, 2 * gates * hidden)}
        initializers += [numpy_helper.from_array(value, f"{name}{number}") for name, value in parts.items()]
        for state in states:
            limits = [f"{state}_in", "zero" if number == 0 else "one", "one" if number == 0 else "two", "zero"]
            nodes.append(node("Slice", limits, [f"{state}_was{number}"]))
        given = [head, f"W{number}", f"R{number}", f"B{number}", "", *(f"{state}_was{number}" for state in states)]
        gives = [f"y{number}", *(f"{state}n{number}" for state in states)]
        more = {"linear_before_reset": 1} if kind == "GRU" else {}
        nodes.append(node(kind, given, gives, hidden_size=hidden, **more))
        head = f"x{number + 1}"
        nodes.append(node("Squeeze", [f"y{number}", "one"], [head]))
    for state in states:
        nodes.append(node("Concat", [f"{state}n{number}" for number in range(depth)], [f"{state}_out"], axis=0))
    nodes.append(node("Squeeze", [head, "zero"], ["latent"]))
    own, more = perceptron([layer(rng, hidden, 8), layer(rng, 8, JOINTS)], "latent")
    state = [depth, 1, hidden]
    session = save_graph(
        out / f"{kind.lower()}.onnx",
        nodes + own,
        initializers + more,
        [("obs", [1, WIDTH]), *((f"{name}_in", state) for name in states)],
        [("actions", [1, JOINTS]), *((f"{name}_out", state) for name in states)],
    )
    rows = rng.normal(0, 1, (40, WIDTH)).astype(np.float32)
    memory, actions = [np.zeros(state, np.float32) for _ in states], []
    for row in rows:
        action, *memory = session.run(None, {"obs": row[None], **{f"{s}_in": m for s, m in zip(states, memory)}})
        actions.append(action[0])
    save_rows(out, kind.lower(), rows, actions)
    describe(out, kind.lower(), f"{kind.lower()}.onnx")


def functions_onnx(out, rng):
    """Activations and layer norm in the nodes that PyTorch's exporter writes for operator set 17."""
    node = helper.make_node
    number = lambda name, value: numpy_helper.from_array(np.array(value, np.float32), name)
    constants = [number("root", 2**0.5), number("one", 1), number("half", 0.5), number("pi", (2 / np.pi) ** 0.5),
                 number("cubic", 0.044715), number("three", 3), number("two", 2), number("eps", 1e-3)]

    def silu(x):
        return [node("Sigmoid", [x], [x + "s"]), node("Mul", [x, x + "s"], [x + "f"])]

    def gelu(x):
        return [node("Div", [x, "root"], [x + "d"]), node("Erf", [x + "d"], [x + "e"]), node("Add", [x + "e", "one"], [x + "a"]),
                node("Mul", [x, x + "a"], [x + "m"]), node("Mul", [x + "m", "half"], [x + "f"])]

    def gelu_tanh(x):
        return [node("Pow", [x, "three"], [x + "p"]), node("Mul", [x + "p", "cubic"], [x + "c"]),
                node("Add", [x, x + "c"], [x + "i"]), node("Mul", [x + "i", "pi"], [x + "o"]), node("Tanh", [x + "o"], [x + "t"]),
                node("Add", [x + "t", "one"], [x + "a"]), node("Mul", [x, "half"], [x + "h"]),
                node("Mul", [x + "h", x + "a"], [x + "f"])]

    def norm(x):
        return [node("ReduceMean", [x], [x + "u"], axes=[-1]), node("Sub", [x, x + "u"], [x + "c"]),
                node("Pow", [x + "c", "two"], [x + "q"]), node("ReduceMean", [x + "q"], [x + "v"], axes=[-1]),
                node("Add", [x + "v", "eps"], [x + "w"]), node("Sqrt", [x + "w"], [x + "r"]),
                node("Div", [x + "c", x + "r"], [x + "n"]), node("Mul", [x + "n", x + "_weight"], [x + "k"]),
                node("Add", [x + "k", x + "_bias"], [x + "b"]), node("Elu", [x + "b"], [x + "f"], alpha=0.5)]

    plain = {"leaky_relu": ("LeakyRelu", {"alpha": 0.2}), "selu": ("Selu", {})}
    for name in ("silu", "gelu", "gelu_tanh", "leaky_relu", "selu", "norm"):
        nodes, initializers, head = [], list(constants), "obs"
        for index, (weight, bias) in enumerate([layer(rng, WIDTH, 16), layer(rng, 16, 8), layer(rng, 8, JOINTS)]):
            x = f"x{index}"
            initializers += [numpy_helper.from_array(weight * 3, x + ".w"), numpy_helper.from_array(bias, x + ".b")]
            nodes.append(node("Gemm", [head, x + ".w", x + ".b"], [x], transB=1))
            if index == 2:
                nodes.append(node("Tanh" if name == "norm" else "Identity", [x], ["actions"]))
                break
            if name == "norm":
                parts = (f"{x}_weight", rng.uniform(0.5, 1.5, len(bias))), (f"{x}_bias", rng.normal(0, 0.3, len(bias)))
                initializers += [numpy_helper.from_array(value.astype(np.float32), part) for part, value in parts]
            if name in plain:
                operator, attributes = plain[name]
                nodes.append(node(operator, [x], [x + "f"], **attributes))
            else:
                nodes += {"silu": silu, "gelu": gelu, "gelu_tanh": gelu_tanh, "norm": norm}[name](x)
            head = x + "f"
        used = {given for each in nodes for given in each.input}
        initializers = [tensor for tensor in initializers if tensor.name in used]
        ends = [("obs", ["batch", WIDTH])], [("actions", ["batch", JOINTS])]
        session = save_graph(out / f"functions/{name}.onnx", nodes, initializers, *ends)
        rows = rng.normal(0, 1, (ROWS, WIDTH)).astype(np.float32)
        save_rows(out / "functions", name, rows, session.run(None, {"obs": rows})[0])
        describe(out / "functions", name, f"{name}.onnx")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    default = ROOT / "crates/gaitfit-policy-files/tests/fixtures/policies"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(45)
    foreign_onnx(out, rng)
    trainer_safetensors(out, rng)
    mjlab_onnx(out, np.random.default_rng(48))
    motion_onnx(out, np.random.default_rng(69))
    unitree_folders(out, np.random.default_rng(225))
    functions_onnx(out, np.random.default_rng(17))
    recurrent_onnx(out, np.random.default_rng(4), "LSTM")
    recurrent_onnx(out, np.random.default_rng(3), "GRU")


if __name__ == "__main__":
    main()
