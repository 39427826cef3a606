"""The hand-written derivatives equal autograd's, and the estimators equal their definitions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.func import functional_call

from vic_toolbox.errors import InputError
from vic_toolbox.learning.networks import GaussianPolicy, Mlp
from vic_toolbox.learning.reward import slope_penalty
from vic_toolbox.learning.rollouts import generalised_advantages
from vic_toolbox.learning.trpo import TrpoConfiguration, conjugate_gradient, fisher_product, trpo_step


def reference(network: Mlp) -> torch.nn.Sequential:
    """The same network made of torch modules."""
    activation = torch.nn.Tanh if network.activation == "tanh" else torch.nn.ReLU
    modules: list[torch.nn.Module] = []
    for weight, bias in network.layers:
        linear = torch.nn.Linear(weight.shape[1], weight.shape[0])
        linear.weight.data, linear.bias.data = weight.clone(), bias.clone()
        modules += [linear, activation()]
    return torch.nn.Sequential(*modules[:-1])


def flat(tensors) -> torch.Tensor:
    return torch.cat([tensor.reshape(-1) for tensor in tensors])


def random_network(activation: str, seed: int = 0, sizes=(5, 8, 6, 3)) -> Mlp:
    network = Mlp(sizes, activation, generator=torch.Generator().manual_seed(seed))
    network.theta.add_(
        0.1 * torch.randn(network.theta.shape, generator=torch.Generator().manual_seed(seed + 1))
    )
    return network


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@given(seed=st.integers(0, 1000), rows=st.integers(1, 9))
@settings(max_examples=20, deadline=None)
def test_network_products_equal_autograd(activation, seed, rows):
    network = random_network(activation, seed)
    module = reference(network)
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(rows, 5, generator=generator)
    cotangent = torch.randn(rows, 3, generator=generator)
    direction = torch.randn(network.theta.shape, generator=generator)

    output, activations = network.forward(x)
    torch.testing.assert_close(output, module(x))
    torch.testing.assert_close(network.value(x), output)
    expected = flat(torch.autograd.grad((module(x) * cotangent).sum(), list(module.parameters())))
    torch.testing.assert_close(network.gradient(activations, cotangent), expected, rtol=1e-4, atol=1e-5)

    names = [name for name, _ in module.named_parameters()]
    tangents = flat_to_dict(network, direction, names)
    expected_tangent = torch.func.jvp(
        lambda parameters: functional_call(module, parameters, (x,)),
        (dict(module.named_parameters()),),
        (tangents,),
    )[1]
    torch.testing.assert_close(
        network.tangent(activations, direction), expected_tangent, rtol=1e-4, atol=1e-5
    )


def flat_to_dict(network: Mlp, vector: torch.Tensor, names: list[str]) -> dict[str, torch.Tensor]:
    parts = [part for layer in network.split(vector) for part in layer]
    return dict(zip(names, parts, strict=True))


@given(seed=st.integers(0, 1000), bound=st.floats(0.0, 2.0))
@settings(max_examples=20, deadline=None)
def test_slope_penalty_equals_double_backpropagation(seed, bound):
    network = random_network("relu", seed, sizes=(5, 8, 6, 1))
    module = reference(network)
    x = torch.randn(7, 5, generator=torch.Generator().manual_seed(seed), requires_grad=True)
    (slope,) = torch.autograd.grad(module(x).sum(), x, create_graph=True)
    expected = (slope.norm(dim=1) - bound).clamp(min=0).square().mean()
    gradients = torch.autograd.grad(expected, list(module.parameters()), allow_unused=True)
    parameters = list(module.parameters())
    filled = [torch.zeros_like(p) if g is None else g for p, g in zip(parameters, gradients, strict=True)]
    value, gradient = slope_penalty(network, x.detach(), bound=bound)
    torch.testing.assert_close(value, expected.detach(), rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(gradient, flat(filled), rtol=1e-3, atol=1e-5)


def random_policy(seed: int = 0, log_std: float = -0.7) -> GaussianPolicy:
    return GaussianPolicy(np.linspace(0.5, 2.0, 4), 2, hidden=8, log_std=log_std, seed=seed)


def test_fisher_product_is_the_hessian_of_the_divergence():
    policy = random_policy()
    x = torch.randn(30, 4, generator=torch.Generator().manual_seed(3))
    module, log_std = reference(policy.network), policy.log_std.clone().requires_grad_()
    mean_old, log_std_old = module(x).detach(), log_std.detach()
    parameters = [*module.parameters(), log_std]
    divergence = policy.divergence(mean_old, log_std_old, module(x), log_std)
    slope = flat(torch.autograd.grad(divergence, parameters, create_graph=True))
    vector = torch.randn(policy.theta.shape, generator=torch.Generator().manual_seed(4))
    hessian_vector = flat(torch.autograd.grad(slope @ vector, parameters))
    product = fisher_product(policy, x, damping=0.1)
    torch.testing.assert_close(product(vector), hessian_vector + 0.1 * vector, rtol=1e-4, atol=1e-5)


def test_conjugate_gradient_solves_a_positive_definite_system():
    generator = torch.Generator().manual_seed(0)
    root = torch.randn(6, 6, generator=generator, dtype=torch.float64)
    matrix = root @ root.T + torch.eye(6, dtype=torch.float64)
    target = torch.randn(6, generator=generator, dtype=torch.float64)
    solution = conjugate_gradient(lambda v: matrix @ v, target, 20)
    torch.testing.assert_close(matrix @ solution, target, rtol=1e-4, atol=1e-4)


@given(seed=st.integers(0, 100), limit=st.sampled_from([1e-3, 1e-2, 5e-2]))
@settings(max_examples=15, deadline=None)
def test_trpo_step_improves_the_surrogate_inside_the_trust_region(seed, limit):
    policy = random_policy(seed)
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(400, 4, generator=generator)
    old = policy.copy()
    mean = old.network.value(x)
    actions = mean + old.log_std.exp() * torch.randn(mean.shape, generator=generator)
    advantages = torch.tanh(x[:, 0]) * (actions - mean)[:, 0]
    step = trpo_step(
        policy,
        x,
        actions,
        advantages,
        divergence_limit=limit,
        configuration=TrpoConfiguration(fisher_stride=1),
    )
    new_mean = policy.network.value(x)
    divergence = float(old.divergence(mean, old.log_std, new_mean, policy.log_std))
    assert step.improvement > 0.0
    assert divergence == pytest.approx(step.divergence, rel=1e-3, abs=1e-6)
    assert 0.0 < divergence <= 1.5 * limit


def test_trpo_leaves_the_policy_alone_when_no_step_helps():
    policy = random_policy()
    x = torch.randn(50, 4, generator=torch.Generator().manual_seed(1))
    before = policy.theta.clone()
    step = trpo_step(
        policy,
        x,
        policy.network.value(x),
        torch.zeros(50),
        divergence_limit=0.01,
        configuration=TrpoConfiguration(),
    )
    assert step.fraction == 0.0
    assert torch.equal(policy.theta, before)


@given(
    seed=st.integers(0, 1000),
    discount=st.floats(0.5, 1.0),
    trace=st.floats(0.0, 1.0),
    length=st.integers(1, 12),
)
@settings(max_examples=30, deadline=None)
def test_generalised_advantages_equal_their_definition(seed, discount, trace, length):
    rng = np.random.default_rng(seed)
    rewards, values = rng.normal(size=(length, 2)), rng.normal(size=(length + 1, 2))
    advantages, returns = generalised_advantages(rewards, values, discount=discount, trace=trace)
    delta = rewards + discount * values[1:] - values[:-1]
    expected = [
        sum((discount * trace) ** (k - t) * delta[k] for k in range(t, length)) for t in range(length)
    ]
    np.testing.assert_allclose(advantages, expected, atol=1e-10)
    np.testing.assert_allclose(returns, advantages + values[:-1], atol=1e-12)


def test_full_trace_gives_discounted_returns():
    rng = np.random.default_rng(0)
    rewards, values = rng.normal(size=(6, 3)), rng.normal(size=(7, 3))
    _, returns = generalised_advantages(rewards, values, discount=0.9, trace=1.0)
    total = values[-1]
    for t in range(5, -1, -1):
        total = rewards[t] + 0.9 * total
        np.testing.assert_allclose(returns[t], total, atol=1e-12)


def test_numpy_and_torch_forward_agree():
    policy = random_policy()
    observations = np.random.default_rng(0).normal(size=(9, 4))
    expected = policy.network.value(policy.scaled(observations)).numpy()
    np.testing.assert_allclose(policy.mean(observations), expected, atol=1e-6)


def test_log_probability_is_the_normal_density():
    policy = random_policy()
    generator = torch.Generator().manual_seed(0)
    mean, actions = torch.randn(5, 2, generator=generator), torch.randn(5, 2, generator=generator)
    expected = torch.distributions.Normal(mean, policy.log_std.exp()).log_prob(actions).sum(1)
    torch.testing.assert_close(policy.log_probability(mean, policy.log_std, actions), expected)


def test_an_unknown_activation_is_refused():
    with pytest.raises(InputError, match="gelu"):
        Mlp((2, 2), "gelu", generator=torch.Generator())
