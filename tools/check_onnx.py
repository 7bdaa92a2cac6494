"""Checks an exported ONNX policy in onnxruntime: the graph is valid, and its outputs are those of another reading.

The other reading is the policy's safetensors file, evaluated here in double precision from its tensors (--weights), or
given rows of observations and actions (--rows, JSON with `observation` and `actions`). Also checks that a batch gives
what its rows give one by one. Rows of a recurrent policy are steps of one robot; what it remembers goes from the outputs
h_out and c_out to the inputs h_in and c_in. Prints the largest difference; exit code 3 if it is above --tolerance.

Usage: .venv/bin/python tools/check_onnx.py policy.onnx [--weights policy.safetensors] [--rows rows.json]
       (gaitfit export POLICY --onnx policy.onnx --safetensors policy.safetensors writes both)
"""

import argparse
import json
import math
import pathlib
import sys

import numpy as np
import onnx
import onnxruntime

ERF = np.vectorize(math.erf)
SELU = 1.6732632423543772, 1.0507009873554805
# Of x and, where there is one, a parameter.
ACTIVATIONS = {
    "elu": lambda x, alpha=1.0: np.where(x > 0, x, alpha * np.expm1(np.minimum(x, 0))),
    "relu": lambda x: np.maximum(x, 0),
    "tanh": np.tanh,
    "leaky_relu": lambda x, slope=0.01: np.where(x > 0, x, slope * x),
    "selu": lambda x: SELU[1] * np.where(x > 0, x, SELU[0] * np.expm1(np.minimum(x, 0))),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "gelu": lambda x: 0.5 * x * (1 + ERF(x / math.sqrt(2))),
    "gelu_tanh": lambda x: 0.5 * x * (1 + np.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * x**3))),
}
TYPES = {"F32": np.float32, "F64": np.float64}


def read_safetensors(path):
    """Tensors by name in double precision, and the JSON header in the metadata."""
    data = path.read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    about = json.loads(header.pop("__metadata__")["gaitfit"])
    tensors = {}
    for name, tensor in header.items():
        begin, end = (start + offset for offset in tensor["data_offsets"])
        values = np.frombuffer(data[begin:end], TYPES[tensor["dtype"]])
        tensors[name] = values.reshape(tensor["shape"]).astype(float)
    return tensors, about


def function(written):
    """An activation as the header has it: a name, or a name and its parameter."""
    if isinstance(written, str):
        return ACTIVATIONS[written]
    ((name, parameter),) = written.items()
    return lambda x: ACTIVATIONS[name](x, parameter)


def remember(tensors, cell, x):
    """Outputs of the recurrent layers along the rows x, in PyTorch's order of gates."""
    sigmoid = lambda x: 1 / (1 + np.exp(-x))
    for number in range(sum(name.startswith("memory.weight_ih_l") for name in tensors)):
        names = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        w, u, b, c = (tensors[f"memory.{name}_l{number}"] for name in names)
        h = kept = np.zeros(u.shape[1])
        outputs = []
        for row in x:
            given, own = w @ row + b, u @ h + c
            if cell == "lstm":
                i, f, g, o = np.split(given + own, 4)
                kept = sigmoid(f) * kept + sigmoid(i) * np.tanh(g)
                h = sigmoid(o) * np.tanh(kept)
            else:
                (rx, zx, nx), (rh, zh, nh) = np.split(given, 3), np.split(own, 3)
                z = sigmoid(zx + zh)
                h = (1 - z) * np.tanh(nx + sigmoid(rx + rh) * nh) + z * h
            outputs.append(h)
        x = np.array(outputs)
    return x


def evaluate(tensors, about, x):
    """Mean actions for rows of observations."""
    x = x.astype(float)
    if "normaliser.mean" in tensors:
        x = (x - tensors["normaliser.mean"]) / np.sqrt(tensors["normaliser.variance"] + 0.01)
    if "front" in about:
        x = remember(tensors, about["front"]["memory"], x)
    numbers = sorted(int(name.split(".")[1]) for name in tensors if name.startswith("actor.") and name.endswith("weight"))
    for number in numbers:
        weight, bias = tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"]
        if weight.ndim == 1:
            spread = np.sqrt(x.var(axis=1, keepdims=True) + about["layer_norm_epsilon"])
            x = (x - x.mean(axis=1, keepdims=True)) / spread * weight + bias
            continue
        x = (x if number == 0 else function(about["activation"])(x)) @ weight.T + bias
    return function(about["output_activation"])(x) if "output_activation" in about else x


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("onnx", type=pathlib.Path)
    parser.add_argument("--weights", type=pathlib.Path, help="the same policy as safetensors")
    parser.add_argument("--rows", type=pathlib.Path, help="JSON with `observation` and `actions`, lists of rows")
    parser.add_argument("--tolerance", type=float, default=1e-5)
    args = parser.parse_args()
    if not (args.weights or args.rows):
        parser.error("give --weights or --rows to compare with")

    onnx.checker.check_model(str(args.onnx), full_check=True)
    session = onnxruntime.InferenceSession(str(args.onnx), providers=["CPUExecutionProvider"])
    (given, *states), (gives, *_) = session.get_inputs(), session.get_outputs()
    metadata = session.get_modelmeta().custom_metadata_map
    interface = json.loads(metadata["gaitfit"])["interface"]

    def along(rows):
        """Actions of one robot along its steps."""
        kept = {state.name: np.zeros((state.shape[0], 1, state.shape[2]), np.float32) for state in states}
        actions = []
        for row in rows:
            action, *after = session.run(None, {given.name: row[None], **kept})
            actions.append(action)
            kept = dict(zip(kept, after, strict=True))
        return np.concatenate(actions)

    def side_by_side(rows):
        """The same of two robots at once, of which the second is asked for."""
        kept = {state.name: np.zeros((state.shape[0], 2, state.shape[2]), np.float32) for state in states}
        actions = []
        for row in rows:
            action, *after = session.run(None, {given.name: np.stack([-row, row]), **kept})
            actions.append(action[1:])
            kept = dict(zip(kept, after, strict=True))
        return np.concatenate(actions)

    run = along if states else lambda rows: session.run([gives.name], {given.name: rows})[0]
    worst = {}
    if args.weights:
        tensors, about = read_safetensors(args.weights)
        rows = np.random.default_rng(0).normal(0, 2, (200 if states else 1000, given.shape[1])).astype(np.float32)
        worst["weights"] = np.abs(run(rows) - evaluate(tensors, about, rows)).max()
        assert about["interface"] == interface, "the files disagree about the interface"
        if states:
            worst["two robots side by side"] = np.abs(run(rows[:50]) - side_by_side(rows[:50])).max()
        else:
            single = np.concatenate([run(row[None]) for row in rows[:50]])
            worst["rows one by one"] = np.abs(run(rows[:50]) - single).max()
    if args.rows:
        table = json.loads(args.rows.read_text())
        worst["given rows"] = np.abs(run(np.array(table["observation"], np.float32)) - np.array(table["actions"])).max()
    print(f"{args.onnx}: {given.name} {given.shape} -> {gives.name} {gives.shape}, {interface['robot']}")
    for what, difference in worst.items():
        print(f"largest difference, {what}: {difference:.2e}")
    # A NaN fails too.
    sys.exit(0 if all(difference <= args.tolerance for difference in worst.values()) else 3)


if __name__ == "__main__":
    main()
