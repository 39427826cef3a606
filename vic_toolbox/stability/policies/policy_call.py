"""How a policy is asked: all observations at once, or one after the other if it was written for one."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from vic_toolbox.errors import Array, InputError

SMALLEST, LARGEST = 1e-3, 1.0
"""Sizes of the observations with which it is found out how."""
ALIKE = 1e-4
"""Largest relative difference between answers that are the same; single precision is finer."""

Ask = Callable[[Array], list[Any]]
"""From observations (n, ·) to the arrays that the policy returns, n of each or one for all."""
Split = Callable[[Array], tuple[Any, ...]]
"""From observations (…, 2 d) to the arguments of a function."""


def policy_call(policy: Any, size: int, history: int) -> Ask:
    """How to ask a policy of `size` axes that wants the last `history` observations.

    A function may be written for one state: for the numbers e and ė (vectors, for several axes) instead of arrays of
    them. That is found out by asking for several states at once and for each of them alone. If the answers differ, as
    with a norm over all that it is given, or if it fails, and it can be asked with one state, then it always is.

    Raises
    ------
    InputError
        It cannot be called, or is a function of e and ė and has a memory.
    """
    call, split = _function(policy, size)
    if split is not None and history > 1:
        raise InputError(
            "a function of e and ė has no memory; leave out history, or let it take the observations."
        )
    split = split or (lambda observations: (observations,))

    def together(observations: Array) -> list[Any]:
        return _parts(call(*split(observations)))

    def alone(observations: Array) -> list[Any]:
        rows = [_parts(call(*split(row))) for row in observations]
        return [np.stack([_spread(part, size) for part in parts]) for parts in zip(*rows, strict=True)]

    count = 2 * size + 1  # neither d nor 2 d, so that what is one for all cannot be taken for one of each
    probes = np.geomspace(SMALLEST, LARGEST, count)[:, None] * np.linspace(1.0, 0.5, 2 * size)
    probes = np.tile(probes, (1, history))
    if _consistent(together, probes) or _tried(alone, probes) is None:
        return together
    return alone


def _consistent(ask: Ask, observations: Array) -> bool:
    """Whether what is answered to many is what is answered to each."""
    many = _tried(ask, observations)
    if many is None:
        return False
    for i in range(len(observations)):
        one = _tried(ask, observations[i : i + 1])
        if one is None or len(one) != len(many):
            return False
        for all_, single in zip(many, one, strict=True):
            own = np.asarray(all_[i] if all_.ndim and len(all_) == len(observations) else all_)
            alike = np.asarray(single[0] if single.ndim and len(single) == 1 else single)
            size = ALIKE * np.abs(alike[np.isfinite(alike)]).max(initial=0.0)
            if own.shape != alike.shape or not np.allclose(own, alike, 0.0, size, equal_nan=True):
                return False
    return True


def _tried(ask: Ask, observations: Array) -> list[Array] | None:
    """Its answer, or None: whatever goes wrong here is said when it is asked in earnest."""
    try:
        with np.errstate(all="ignore"):
            return [np.asarray(part, dtype=np.float64) for part in ask(observations)]
    except Exception:
        return None


def _spread(part: Any, size: int) -> Array:
    """A number for several axes as one for each: (n,) of them could be taken for (d,)."""
    return np.full(size, part) if np.ndim(part) == 0 and size > 1 else np.asarray(part)


def _parts(answer: Any) -> list[Any]:
    if hasattr(answer, "stiffness") and hasattr(answer, "damping"):
        answer = (answer.stiffness, answer.damping)
    parts = list(answer) if isinstance(answer, tuple) else [answer]
    return [part.detach().cpu().numpy() if hasattr(part, "detach") else part for part in parts]


def _function(policy: Any, size: int) -> tuple[Callable[..., Any], Split | None]:
    """A function, and how to split the observations if it wants e and ė (or a lone `e`)."""
    for name in ("mean", "gains"):
        if not callable(policy) and callable(getattr(policy, name, None)):
            policy = getattr(policy, name)
    if not callable(policy):
        raise InputError(f"policy is {type(policy).__name__}; pass a function of the observations [e, ė].")
    torch = sys.modules.get("torch")  # a network can only be given where torch is loaded
    if torch is not None and isinstance(policy, torch.nn.Module):
        network = policy
        weight = next(network.parameters(), torch.zeros(0))
        return lambda x: network(torch.as_tensor(x, dtype=weight.dtype, device=weight.device)), None
    try:
        parameters = inspect.signature(policy).parameters.values()
    except (TypeError, ValueError):  # a compiled function need not have a signature
        return policy, None
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    needed = [p.name for p in parameters if p.kind in positional and p.default is p.empty]
    if len(needed) != 2 and needed not in (["e"], ["error"]):
        return policy, None

    def split(observations: Array) -> tuple[Any, ...]:
        halves = np.split(observations, 2, axis=-1)[: len(needed)]
        return tuple(half[..., 0] if size == 1 else half for half in halves)

    return policy, split
