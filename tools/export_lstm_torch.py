"""Makes a recurrent policy in PyTorch and exports it as rsl_rl does (`forward_lstm` of its exporter): lstm.onnx,
lstm.toml that describes it, and rows.json with observations and onnxruntime's actions along a sequence. PyTorch's own actions are
compared first.

Usage: .venv/bin/python tools/export_lstm_torch.py --out FOLDER [--cell gru] [--layers 2] [--hidden 16]
Needs PyTorch: tools/setup_venv.sh --torch
"""

import argparse
import pathlib

import numpy as np
import onnxruntime
import torch

import make_policy_fixtures as fixtures

STEPS = 60


class Exported(torch.nn.Module):
    """One step: a normaliser, the memory, a perceptron."""

    def __init__(self, cell, layers, hidden):
        super().__init__()
        kind = torch.nn.LSTM if cell == "lstm" else torch.nn.GRU
        self.rnn = kind(fixtures.WIDTH, hidden, num_layers=layers)
        widths = [hidden, 16, 8, fixtures.JOINTS]
        parts = []
        for inputs, outputs in zip(widths, widths[1:]):
            parts += [torch.nn.Linear(inputs, outputs), torch.nn.ELU()]
        self.actor = torch.nn.Sequential(*parts[:-1])

    def forward(self, obs, h_in, c_in):
        x, (h, c) = self.rnn(obs.unsqueeze(0), (h_in, c_in))
        return self.actor(x.squeeze(0)), h, c


class ExportedGru(Exported):
    def forward(self, obs, h_in):
        x, h = self.rnn(obs.unsqueeze(0), h_in)
        return self.actor(x.squeeze(0)), h


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--cell", choices=["lstm", "gru"], default="lstm")
    parser.add_argument("--layers", type=int, default=2)
    parser.add_argument("--hidden", type=int, default=16)
    args = parser.parse_args()
    torch.manual_seed(7)
    module = (Exported if args.cell == "lstm" else ExportedGru)(args.cell, args.layers, args.hidden).eval()
    memories = ["h_in", "c_in"][: 2 if args.cell == "lstm" else 1]
    outputs = ["actions"] + [name.replace("_in", "_out") for name in memories]
    zeros = [torch.zeros(args.layers, 1, args.hidden) for _ in memories]
    path = args.out / f"{args.cell}.onnx"
    example = (torch.zeros(1, fixtures.WIDTH), *zeros)
    torch.onnx.export(
        module, example, str(path), opset_version=17, input_names=["obs", *memories], output_names=outputs, dynamo=False
    )
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    rows = np.random.default_rng(3).normal(0, 1, (STEPS, fixtures.WIDTH)).astype(np.float32)
    actions, state, own = [], [zero.numpy() for zero in zeros], list(zeros)
    worst = 0.0
    for row in rows:
        action, *state = session.run(None, {"obs": row[None], **dict(zip(memories, state))})
        with torch.no_grad():
            expected, *own = module(torch.from_numpy(row[None]), *own)
        worst = max(worst, float(np.abs(action - expected.numpy()).max()))
        actions.append(action[0])
    assert worst < 1e-5, f"onnxruntime and PyTorch differ by {worst}"
    fixtures.save_rows(args.out, args.cell, rows, np.array(actions))
    fixtures.describe(args.out, args.cell, path.name)
    print(f"PyTorch {torch.__version__}, onnxruntime {onnxruntime.__version__}: they differ by {worst:.1e}")


if __name__ == "__main__":
    main()
