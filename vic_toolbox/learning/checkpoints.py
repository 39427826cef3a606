"""Weights and run states on disk: safetensors, written atomically, checked on reading.

A file holds named tensors and one JSON header. Nothing in it can run code. It is written under a temporary name,
flushed to the disk and renamed, so a reader sees the old file or the new one, never a part.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from vic_toolbox.errors import FileError
from vic_toolbox.files import write_atomically
from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.reward import RewardNetwork

FORMAT = "vic-toolbox/1"


def save_tensors(
    path: str | os.PathLike[str], tensors: Mapping[str, torch.Tensor], header: dict[str, Any]
) -> None:
    """Write tensors and a JSON-serialisable header.

    Raises
    ------
    FileError
        The file cannot be written (no space, no permission); an earlier file of that name is untouched.
    """
    contiguous = {name: tensor.detach().contiguous().clone() for name, tensor in tensors.items()}
    metadata = {FORMAT: json.dumps(header)}  # one entry: safetensors writes several in no fixed order
    write_atomically(path, save(contiguous, metadata=metadata))


def load_tensors(
    path: str | os.PathLike[str], *, kind: str
) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Read tensors and header of a file written by `save_tensors` with `header["kind"] == kind`.

    Raises
    ------
    FileError
        The file is missing, truncated, of another format or kind, or holds non-finite weights.
    """
    path = Path(path)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        if FORMAT not in metadata:
            raise FileError(f"{path} is no {FORMAT} file (it says {list(metadata)!r:.100}); train it again")
        header = json.loads(metadata[FORMAT])
    except (OSError, SafetensorError, KeyError, json.JSONDecodeError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(
            f"{path} cannot be read ({error}); expected a {kind} file written by vic_toolbox"
        ) from error
    if not isinstance(header, dict) or header.get("kind") != kind:
        raise FileError(f"{path} is not a {kind} file; its header says {header!r:.200}")
    if kind != "checkpoint":
        for name, tensor in tensors.items():
            if not bool(torch.isfinite(tensor).all()):
                raise FileError(f"{path}: tensor {name!r} holds values that are not finite; train it again")
    return tensors, header


def save_policy(path: str | os.PathLike[str], policy: GaussianPolicy) -> None:
    """Write a policy: one tensor a layer, log σ, and the observation scale."""
    tensors = _named_layers(policy.network.layers) | {
        "log_std": policy.log_std,
        "observation_scale": torch.from_numpy(policy.observation_scale),
    }
    save_tensors(path, tensors, {"kind": "policy", "sizes": policy.network.sizes})


def load_policy(path: str | os.PathLike[str]) -> GaussianPolicy:
    """Read a policy written by `save_policy`."""
    tensors, header = load_tensors(path, kind="policy")
    try:
        n_in, hidden, same, n_out = header["sizes"]
        policy = GaussianPolicy(
            tensors["observation_scale"].numpy(), n_out, hidden=hidden, log_std=0.0, seed=0
        )
        if same != hidden or n_in != policy.network.sizes[0]:
            raise ValueError(f"sizes {header['sizes']}")
        _fill_layers(policy.network.layers, tensors)
        policy.log_std.copy_(tensors["log_std"])
    except (KeyError, ValueError, TypeError, RuntimeError) as error:
        raise FileError(f"{path} does not hold a policy of this version ({error}); train it again") from error
    return policy


def save_reward(path: str | os.PathLike[str], reward: RewardNetwork) -> None:
    """Write a reward network: one tensor a layer."""
    header = {"kind": "reward", "sizes": reward.network.sizes, "observation_size": reward.observation_size}
    save_tensors(path, _named_layers(reward.network.layers), header)


def load_reward(path: str | os.PathLike[str]) -> RewardNetwork:
    """Read a reward written by `save_reward`."""
    tensors, header = load_tensors(path, kind="reward")
    try:
        n_in, hidden, _, _ = header["sizes"]
        n_o = header["observation_size"]
        reward = RewardNetwork(n_o, n_in - n_o, hidden=hidden, seed=0)
        _fill_layers(reward.network.layers, tensors)
    except (KeyError, ValueError, TypeError, RuntimeError) as error:
        raise FileError(f"{path} does not hold a reward of this version ({error}); train it again") from error
    return reward


def _named_layers(layers: list[tuple[torch.Tensor, torch.Tensor]]) -> dict[str, torch.Tensor]:
    return {
        f"layer_{depth}.{name}": tensor
        for depth, layer in enumerate(layers)
        for name, tensor in zip(("weight", "bias"), layer, strict=True)
    }


def _fill_layers(
    layers: list[tuple[torch.Tensor, torch.Tensor]], tensors: Mapping[str, torch.Tensor]
) -> None:
    for name, tensor in _named_layers(layers).items():
        if tensors[name].shape != tensor.shape:
            raise ValueError(f"{name} has shape {tuple(tensors[name].shape)}, expected {tuple(tensor.shape)}")
        tensor.copy_(tensors[name])
