"""Makes derivatives of recurrent layers by PyTorch's autograd, in double precision, for the tests of gaitfit's own.

Two layers of LSTM or GRU over some steps of some robots; episodes begin in between. All numbers that go in are
0.6 sin(1.3 k + c) of their number k, so that the fixture holds only what comes out.

Usage: .venv/bin/python tools/make_gradient_fixtures.py [--out FILE]
"""

import argparse
import json
import pathlib

import torch

ROOT = pathlib.Path(__file__).parent.parent
INPUTS, HIDDEN, STEPS, ROBOTS = 3, (4, 5), 6, 3
# Robot 1 begins an episode at step 2, robot 2 at step 4 and 5.
BEGINS = {(2, 1), (4, 2), (5, 2)}


def numbers(count, c):
    return 0.6 * torch.sin(1.3 * torch.arange(count, dtype=torch.float64) + c)


def derivatives(cell):
    gates, kind = (4, torch.nn.LSTMCell) if cell == "lstm" else (3, torch.nn.GRUCell)
    sizes = [(INPUTS, HIDDEN[0]), (HIDDEN[0], HIDDEN[1])]
    count = sum(gates * h * (i + h + 2) for i, h in sizes)
    flat, at, layers = numbers(count, 0.2), 0, []
    for inputs, hidden in sizes:
        layer = kind(inputs, hidden, dtype=torch.float64)
        for name, rows in [("weight_ih", inputs), ("weight_hh", hidden), ("bias_ih", 1), ("bias_hh", 1)]:
            size = rows * gates * hidden
            values = flat[at : at + size].reshape(rows, gates * hidden).T.reshape(getattr(layer, name).shape)
            getattr(layer, name).data.copy_(values)
            at += size
        layers.append(layer)
    x = numbers(STEPS * ROBOTS * INPUTS, 0.5).reshape(STEPS, ROBOTS, INPUTS)
    weight = numbers(STEPS * ROBOTS * HIDDEN[1], 0.9).reshape(STEPS, ROBOTS, HIDDEN[1])
    kept = sum(HIDDEN) * (2 if cell == "lstm" else 1)
    start, at, states = numbers(ROBOTS * kept, 0.7).reshape(ROBOTS, kept), 0, []
    for hidden in HIDDEN:
        parts = []
        for _ in range(2 if cell == "lstm" else 1):
            parts.append(start[:, at : at + hidden])
            at += hidden
        states.append(tuple(parts))
    loss, outputs = 0.0, []
    for step in range(STEPS):
        goes_on = torch.tensor([[0.0 if (step, robot) in BEGINS else 1.0] for robot in range(ROBOTS)], dtype=torch.float64)
        value = x[step]
        for number, layer in enumerate(layers):
            state = tuple(part * goes_on for part in states[number])
            state = layer(value, state) if cell == "lstm" else (layer(value, state[0]),)
            states[number], value = state, state[0]
        outputs.append(value)
        # The square makes the derivative depend on the output.
        loss = loss + (weight[step] * value).sum() + 0.5 * (value**2).sum()
    loss.backward()
    gradient = []
    for layer in layers:
        for name in ["weight_ih", "weight_hh"]:
            gradient += getattr(layer, name).grad.T.reshape(-1).tolist()
        gradient += layer.bias_ih.grad.tolist() + layer.bias_hh.grad.tolist()
    rounded = [float(f"{value:.11g}") for value in gradient]
    last = [float(f"{value:.11g}") for value in outputs[-1].detach().reshape(-1).tolist()]
    return {"loss": loss.item(), "last_output": last, "gradient": rounded}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    default = ROOT / "crates/gaitfit-policy/tests/fixtures/recurrent_gradients.json"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    out = parser.parse_args().out
    out.write_text(json.dumps({cell: derivatives(cell) for cell in ["lstm", "gru"]}) + "\n")


if __name__ == "__main__":
    main()
