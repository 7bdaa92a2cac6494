"""A policy's network in PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import nn

_ACTIVATIONS: dict[str, Callable[[float | None], nn.Module]] = {
    "elu": lambda alpha: nn.ELU(1.0 if alpha is None else alpha),
    "relu": lambda _: nn.ReLU(),
    "tanh": lambda _: nn.Tanh(),
    "leaky_relu": lambda slope: nn.LeakyReLU(0.01 if slope is None else slope),
    "selu": lambda _: nn.SELU(),
    "silu": lambda _: nn.SiLU(),
    "gelu": lambda _: nn.GELU(),
    "gelu_tanh": lambda _: nn.GELU(approximate="tanh"),
}


class Actor(nn.Module):  # type: ignore[misc, unused-ignore]
    """From observations, shape ``(robots, observation)``, to mean actions, shape ``(robots, joints)``.

    ``scale`` and ``offset`` are buffers: the normalisation of the observation, which a training does not change.
    """

    scale: torch.Tensor
    offset: torch.Tensor

    def __init__(self, actor: Mapping[str, Any]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        name, parameter = actor["activation"]
        for number, (weight, bias, norm) in enumerate(actor["layers"]):
            layers.append(_linear(weight, bias))
            if norm is not None:
                layers.append(_norm(*norm))
            if number + 1 < len(actor["layers"]):
                layers.append(_ACTIVATIONS[name](parameter))
        if actor["output"] is not None:
            name, parameter = actor["output"]
            layers.append(_ACTIVATIONS[name](parameter))
        self.layers = nn.Sequential(*layers)
        width = actor["layers"][0][0].shape[1]
        scale, offset = actor["scale"], actor["offset"]
        self.register_buffer("scale", torch.from_numpy(scale.copy()) if len(scale) else torch.ones(width))
        self.register_buffer("offset", torch.from_numpy(offset.copy()) if len(offset) else torch.zeros(width))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Mean actions."""
        actions: torch.Tensor = self.layers(observation * self.scale + self.offset)
        return actions


def _linear(weight: Any, bias: Any) -> nn.Linear:
    layer = nn.Linear(weight.shape[1], weight.shape[0])
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(np.ascontiguousarray(weight)))
        layer.bias.copy_(torch.from_numpy(bias))
    return layer


def _norm(weight: Any, bias: Any, epsilon: float) -> nn.LayerNorm:
    layer = nn.LayerNorm(len(weight), eps=epsilon)
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(weight))
        layer.bias.copy_(torch.from_numpy(bias))
    return layer
