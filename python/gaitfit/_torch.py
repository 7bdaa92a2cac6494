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


class _Normalised(nn.Module):  # type: ignore[misc, unused-ignore]
    """``scale`` and ``offset`` are buffers: the normalisation of the observation, which a training does not change."""

    scale: torch.Tensor
    offset: torch.Tensor

    def __init__(self, networks: Mapping[str, Any], width: int) -> None:
        super().__init__()
        scale, offset = networks["scale"], networks["offset"]
        self.register_buffer("scale", torch.from_numpy(scale.copy()) if len(scale) else torch.ones(width))
        self.register_buffer("offset", torch.from_numpy(offset.copy()) if len(offset) else torch.zeros(width))


class Actor(_Normalised):
    """From observations, shape ``(robots, observation)``, to mean actions, shape ``(robots, joints)``."""

    def __init__(self, networks: Mapping[str, Any]) -> None:
        super().__init__(networks, networks["layers"][0][0].shape[1])
        self.layers = _perceptron(networks)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Mean actions."""
        actions: torch.Tensor = self.layers(observation * self.scale + self.offset)
        return actions


class EncodedActor(_Normalised):
    """A two-part policy: ``encoder`` makes a latent of the whole observation, ``layers`` see it and a part of the observation."""

    passed: torch.Tensor

    def __init__(self, networks: Mapping[str, Any]) -> None:
        encoder = networks["encoder"]
        super().__init__(networks, encoder["layers"][0][0].shape[1])
        self.encoder = _perceptron(encoder)
        self.layers = _perceptron(networks)
        self.latent_first = bool(encoder["latent_first"])
        self.register_buffer("passed", torch.tensor(encoder["passed"], dtype=torch.long))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Mean actions."""
        normal = observation * self.scale + self.offset
        parts = [normal[..., self.passed], self.encoder(normal)]
        actions: torch.Tensor = self.layers(torch.cat(parts[::-1] if self.latent_first else parts, dim=-1))
        return actions


class RecurrentActor(_Normalised):
    """A policy with a memory: ``memory`` are layers of ``nn.GRU`` or ``nn.LSTM``, and ``layers`` see their output."""

    def __init__(self, networks: Mapping[str, Any]) -> None:
        recurrent = networks["recurrent"]
        super().__init__(networks, recurrent["layers"][0][0].shape[1])
        self.is_lstm = recurrent["cell"] == "lstm"
        self.memory = nn.ModuleList(_cells(self.is_lstm, *layer) for layer in recurrent["layers"])
        self.layers = _perceptron(networks)
        self.hidden: list[int] = [int(layer[1].shape[1]) for layer in recurrent["layers"]]
        #: Numbers that are remembered of one robot.
        self.state_width = sum(self.hidden) * (2 if self.is_lstm else 1)

    def forward(self, observation: torch.Tensor, state: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean actions, and the state afterwards.

        ``observation`` has the shape ``(robots, observation)``, or ``(steps, robots, observation)`` for steps that follow each
        other. ``state`` has the shape ``(robots, state_width)``: layer after layer the output, then an LSTM's cell. ``None``
        and zeros are the beginning of an episode.
        """
        several = observation.ndim == 3
        seen = (observation if several else observation.unsqueeze(0)) * self.scale + self.offset
        before: torch.Tensor = seen.new_zeros(seen.shape[1], self.state_width) if state is None else state
        after: list[torch.Tensor] = []
        at = 0
        for layer, width in zip(self.memory, self.hidden):
            parts: list[torch.Tensor] = []
            for _ in range(2 if self.is_lstm else 1):
                parts.append(before[:, at : at + width].unsqueeze(0).contiguous())
                at += width
            seen, new = layer(seen, tuple(parts) if self.is_lstm else parts[0])
            after += [one[0] for one in (new if self.is_lstm else (new,))]
        actions: torch.Tensor = self.layers(seen)
        return actions if several else actions[0], torch.cat(after, dim=1)


def module(networks: Mapping[str, Any]) -> nn.Module:
    """The policy of ``networks``, as the native half gives them."""
    if "recurrent" in networks:
        return RecurrentActor(networks)
    return EncodedActor(networks) if "encoder" in networks else Actor(networks)


def _perceptron(network: Mapping[str, Any]) -> nn.Sequential:
    layers: list[nn.Module] = []
    name, parameter = network["activation"]
    for number, (weight, bias, norm) in enumerate(network["layers"]):
        layers.append(_linear(weight, bias))
        if norm is not None:
            layers.append(_norm(*norm))
        if number + 1 < len(network["layers"]):
            layers.append(_ACTIVATIONS[name](parameter))
    if network["output"] is not None:
        name, parameter = network["output"]
        layers.append(_ACTIVATIONS[name](parameter))
    return nn.Sequential(*layers)


def _cells(is_lstm: bool, weight_ih: Any, weight_hh: Any, biases: Any) -> nn.GRU | nn.LSTM:
    sizes = int(weight_ih.shape[1]), int(weight_hh.shape[1])
    layer: nn.GRU | nn.LSTM = nn.LSTM(*sizes) if is_lstm else nn.GRU(*sizes)
    with torch.no_grad():
        for name, values in (("weight_ih", weight_ih), ("weight_hh", weight_hh), ("bias_ih", biases[0]), ("bias_hh", biases[1])):
            getattr(layer, f"{name}_l0").copy_(torch.from_numpy(np.ascontiguousarray(values)))
    return layer


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
