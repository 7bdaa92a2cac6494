"""Makes policies as PyTorch's default exporter writes them, for the tests of gaitfit's reader, in
crates/gaitfit-policy-files/tests/fixtures/policies/exported. Each has a TOML file that describes it, and observations with
onnxruntime's actions.

clip.onnx ends in Clip, clip_scaled.onnx in Clip and Mul. gaussian.onnx gives mean and standard deviation in one row and acts
with tanh of the first half (Brax, MuJoCo Playground), gaussian_slice.onnx by a Slice. external.onnx has its weights in
external.onnx.data. lstm.onnx (one layer) and gru.onnx (two) are recurrent; the weights of lstm.onnx are too large for the
exporter to reorder their gates, so the graph does. Random weights, seeded.

Usage: .venv/bin/python tools/make_export_fixtures.py [--out FOLDER]
Needs PyTorch: tools/setup_venv.sh --torch
"""

import argparse
import json
import pathlib

import numpy as np
import onnx
import onnxruntime
import torch

import make_policy_fixtures as fixtures

ROWS, STEPS = 6, 20
UNITS = {"lstm": 46, "gru": 8}


class Perceptron(torch.nn.Module):
    """A normaliser, two layers, and what stands behind them."""

    def __init__(self, outputs, activation, behind, gain=1.0):
        super().__init__()
        self.register_buffer("mean", torch.linspace(-0.3, 0.3, fixtures.WIDTH))
        self.register_buffer("std", torch.linspace(0.5, 2.0, fixtures.WIDTH))
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(fixtures.WIDTH, 16), activation, torch.nn.Linear(16, outputs)
        )
        self.layers[2].weight.data *= gain
        self.behind = behind

    def forward(self, obs):
        return self.behind(self.layers((obs - self.mean) / self.std))


class Recurrent(torch.nn.Module):
    def __init__(self, cell, layers):
        super().__init__()
        kind = torch.nn.LSTM if cell == "lstm" else torch.nn.GRU
        units = UNITS[cell]
        self.rnn = kind(fixtures.WIDTH, units, num_layers=layers)
        self.actor = torch.nn.Sequential(torch.nn.Linear(units, 8), torch.nn.ELU(), torch.nn.Linear(8, fixtures.JOINTS))


class Lstm(Recurrent):
    def forward(self, obs, h_in, c_in):
        x, (h, c) = self.rnn(obs.unsqueeze(0), (h_in, c_in))
        return self.actor(x.squeeze(0)), h, c


class Gru(Recurrent):
    def forward(self, obs, h_in):
        x, h = self.rnn(obs.unsqueeze(0), h_in)
        return self.actor(x.squeeze(0)), h


def rows(seed, count):
    return np.round(np.random.default_rng(seed).normal(0, 1, (count, fixtures.WIDTH)), 2).astype(np.float32)


def save(out, name, observation, actions):
    listed = lambda table: [[float(f"{x:.8g}") for x in row] for row in table]
    table = {"observation": listed(observation), "actions": listed(actions)}
    (out / f"{name}_rows.json").write_text(json.dumps(table) + "\n")
    fixtures.describe(out, name, f"{name}.onnx")


def without_paths(path: pathlib.Path) -> None:
    """Drops the exporter's stack traces, which name the folders of the machine."""
    model = onnx.load(path, load_external_data=False)
    for node in model.graph.node:
        del node.metadata_props[:]
    for value in [*model.graph.value_info, *model.graph.input, *model.graph.output, *model.graph.initializer]:
        del value.metadata_props[:]
    path.write_bytes(model.SerializeToString())


def session(path):
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = fixtures.ROOT / "crates/gaitfit-policy-files/tests/fixtures/policies/exported"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(11)
    joints = fixtures.JOINTS
    elu, silu = torch.nn.ELU(), torch.nn.SiLU()
    perceptrons = {
        "clip": Perceptron(joints, elu, lambda y: torch.clamp(y, -1.0, 1.0), gain=3.0),
        "clip_scaled": Perceptron(joints, elu, lambda y: torch.clamp(y, -0.5, 0.5) * 2.0, gain=3.0),
        "gaussian": Perceptron(2 * joints, silu, lambda y: torch.tanh(torch.chunk(y, 2, dim=-1)[0])),
        "gaussian_slice": Perceptron(2 * joints, silu, lambda y: torch.tanh(y[:, :joints])),
        "external": Perceptron(joints, elu, lambda y: y),
    }
    for number, (name, module) in enumerate(perceptrons.items()):
        path = out / f"{name}.onnx"
        example = (torch.zeros(1, fixtures.WIDTH),)
        outside = name == "external"
        torch.onnx.export(
            module.eval(), example, str(path), input_names=["obs"], output_names=["actions"], external_data=outside
        )
        without_paths(path)
        observation, run = rows(number, ROWS), session(path)
        save(out, name, observation, [run.run(None, {"obs": row[None]})[0][0] for row in observation])
    for number, (name, module) in enumerate({"lstm": Lstm("lstm", 1), "gru": Gru("gru", 2)}.items()):
        path, states = out / f"{name}.onnx", {"lstm": ["h", "c"], "gru": ["h"]}[name]
        zeros = [torch.zeros(module.rnn.num_layers, 1, UNITS[name]) for _ in states]
        inputs = ["obs", *(f"{state}_in" for state in states)]
        outputs = ["actions", *(f"{state}_out" for state in states)]
        example = (torch.zeros(1, fixtures.WIDTH), *zeros)
        torch.onnx.export(
            module.eval(), example, str(path), input_names=inputs, output_names=outputs, external_data=False
        )
        without_paths(path)
        observation, run, memory = rows(10 + number, STEPS), session(path), [zero.numpy() for zero in zeros]
        actions = []
        for row in observation:
            action, *memory = run.run(None, {"obs": row[None], **dict(zip(inputs[1:], memory))})
            actions.append(action[0])
        save(out, name, observation, actions)


if __name__ == "__main__":
    main()
