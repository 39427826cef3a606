"""The algorithms recover known answers, repeat themselves, and resume exactly."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.toy_task import ToyEnvironment, toy_expert
from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.learning import (
    Airl,
    AirlConfiguration,
    CloningConfiguration,
    DiscriminatorConfiguration,
    ExpertData,
    GaussianPolicy,
    PolicySearchConfiguration,
    RewardNetwork,
    Transfer,
    TransferConfiguration,
    clone,
    load_policy,
    load_reward,
    save_policy,
    save_reward,
)
from vic_toolbox.learning.checkpoints import load_tensors, save_tensors
from vic_toolbox.learning.replay import Mixture, Replay
from vic_toolbox.learning.reward import train_discriminator
from vic_toolbox.learning.strata import stratified_rows

SEARCH = PolicySearchConfiguration(environments=16)
SETTINGS = AirlConfiguration(iterations=12, search=SEARCH, restart_after=1000, sharpen_iterations=5)


def test_the_discriminator_recovers_a_known_reward():
    """Expert `a ~ N(W o, s²)`: the optimal logit is `log π_E − log π`, so r must equal log π_E, constant included."""
    generator = torch.Generator().manual_seed(0)
    count, spread, width = 20000, 0.5, 1.0
    slope = torch.tensor([[0.6], [-0.4]])

    def normal(mean, std, actions):
        return torch.distributions.Normal(mean, std).log_prob(actions)[:, 0]

    def samples(std):
        observations = torch.randn(count, 2, generator=generator)
        mean = observations @ slope if std == spread else torch.zeros(count, 1)
        return observations, mean + std * torch.randn(count, 1, generator=generator)

    (expert_o, expert_a), (policy_o, policy_a) = samples(spread), samples(width)
    zero, one_stratum = torch.zeros(count, 1), np.zeros(count, dtype=int)
    reward = RewardNetwork(2, 1, seed=0)
    for steps, rate in ((1500, 3e-3), (1500, 5e-4)):
        train_discriminator(
            reward,
            (torch.cat([expert_o, expert_a], 1), normal(zero, width, expert_a), one_stratum),
            (torch.cat([policy_o, policy_a], 1), normal(zero, width, policy_a), one_stratum),
            slope_bound=1e9,
            learning_rate=rate,
            configuration=DiscriminatorConfiguration(steps=steps, penalty=0.0),
            rng=np.random.default_rng(steps),
        )
    observations = torch.randn(2000, 2, generator=generator)
    actions = observations @ slope + spread * torch.randn(2000, 1, generator=generator)
    learned = reward.value(torch.cat([observations, actions], 1))
    truth = normal(observations @ slope, spread, actions)
    assert float((learned - truth).square().mean().sqrt()) < 0.15
    assert abs(float((learned - truth).mean())) < 0.06
    assert float(torch.corrcoef(torch.stack([learned, truth]))[0, 1]) > 0.97


def test_the_slope_bound_bounds_the_slope():
    rng = np.random.default_rng(0)
    expert = torch.randn(400, 3, generator=torch.Generator().manual_seed(0)) * 0.05 + 1.0
    policy = torch.randn(400, 3, generator=torch.Generator().manual_seed(1))
    reward = RewardNetwork(2, 1, seed=0)
    rest = torch.zeros(400), np.zeros(400, dtype=int)
    settings = DiscriminatorConfiguration(steps=800, batch=128)
    train_discriminator(
        reward,
        (expert, *rest),
        (policy, *rest),
        slope_bound=1.0,
        learning_rate=2e-3,
        configuration=settings,
        rng=rng,
    )
    z = torch.lerp(policy, expert, torch.rand(400, 1)).requires_grad_()
    with torch.enable_grad():
        (slope,) = torch.autograd.grad(reward.value(z).sum(), z)
    assert float(slope.norm(dim=1).quantile(0.95)) < 1.3


def test_every_stratum_is_drawn_equally_often():
    strata = np.repeat([3, 0, 7], [5, 900, 95])
    rows = stratified_rows(strata, (30, 1000), np.random.default_rng(0)).numpy()
    for stratum in (0, 3, 7):
        assert np.mean(strata[rows] == stratum) == pytest.approx(1 / 3, abs=0.02)
    counts = np.bincount(rows.ravel(), minlength=1000)
    assert counts[:5].min() > 1800  # rows 0-4, the rare stratum, come about 2000 times each


def test_cloning_recovers_the_expert():
    environment = ToyEnvironment(100)
    expert = toy_expert(environment)
    policy = fresh_policy(environment)
    settings = CloningConfiguration(steps=3000, batch=256)
    error = clone(policy, expert, configuration=settings, rng=np.random.default_rng(0))
    assert error < 0.02
    assert error == pytest.approx(expert.action_error(policy))


def fresh_policy(environment: ToyEnvironment, seed: int = 0) -> GaussianPolicy:
    task = environment.task
    return GaussianPolicy(task.observation_scale, task.action_size, hidden=32, log_std=-0.5, seed=seed)


def test_airl_imitates_and_its_reward_teaches_a_fresh_policy():
    environment = ToyEnvironment(100)
    settings = replace(SETTINGS, iterations=50, sharpen_iterations=30)
    learner = Airl(environment, toy_expert(environment), configuration=settings, seed=1)
    first = learner.iterate()
    while not learner.finished:
        last = learner.iterate()
    assert last["action_error"] < 0.2 < first["action_error"]
    assert float(learner.best_sharpness) == last["sharpness"] == 1.0
    assert float(learner.best_error) <= last["action_error"]
    policy, reward = learner.result()
    transfer = Transfer(
        environment,
        reward,
        policy,
        configuration=TransferConfiguration(iterations=40, fresh=True, divergence=0.03, search=SEARCH),
        seed=5,
    )
    scores = [transfer.iterate()["score"] for _ in range(40)]
    assert transfer.finished
    assert (
        np.mean(scores[-5:]) > 0.5 * scores[0]
    )  # scores are negative: less than half the fresh policy's loss
    assert learner.expert.action_error(transfer.result()) < 0.6 * first["action_error"]


def test_the_density_of_a_mixture_integrates_to_one():
    """And is that of its policies, each by its share; a mixture of one is the policy."""
    policies = [GaussianPolicy(np.ones(3), 1, hidden=8, log_std=-0.5, seed=seed) for seed in range(3)]
    weights = torch.tensor([0.6, 0.3, 0.1])
    state = torch.randn(3, generator=torch.Generator().manual_seed(4))
    actions = torch.linspace(-6.0, 6.0, 4001)[:, None]
    samples = torch.cat([state.expand(4001, 3), actions], dim=1)
    density = Mixture(policies, weights).log_density(samples).exp()
    assert float(torch.trapezoid(density, actions[:, 0])) == pytest.approx(1.0, abs=1e-5)
    each = [Mixture([policy], torch.ones(1)).log_density(samples).exp() for policy in policies]
    torch.testing.assert_close(density, sum(w * one for w, one in zip(weights, each, strict=True)))
    mean = policies[0].network.value(state[None])
    alone = policies[0].log_probability(mean, policies[0].log_std, actions)
    torch.testing.assert_close(each[0], alone.exp())


@given(count=st.integers(0, 4), stride=st.integers(1, 3), iterations=st.integers(0, 16))
def test_a_replay_holds_the_last_few_of_every_so_many_iterations(count, stride, iterations):
    """Each with the policy that drew it, and a share of what is seen as large as its part of the samples."""
    policy = GaussianPolicy(np.ones(2), 1, hidden=2, log_std=0.0, seed=0)
    replay = Replay(count, stride=stride, policy=policy, shape=(10, 3))

    def drawn(iteration: int) -> torch.Tensor:
        policy.theta.fill_(float(iteration))
        return torch.full((10, 3), float(iteration))

    for iteration in range(iterations):
        replay.keep(drawn(iteration), policy, iteration=iteration)
    every, mixture = replay.mixed(drawn(iterations), policy, iteration=iterations)
    earlier = set(list(range(0, iterations, stride))[-count:] if count else [])
    assert float(mixture.policies[0].theta[0]) == iterations
    assert {float(one.theta[0]) for one in mixture.policies[1:]} == earlier
    rows = torch.cat([torch.full((10,), float(iterations)), *(torch.full((2,), float(i)) for i in earlier)])
    torch.testing.assert_close(every[:, 0].sort().values, rows.sort().values)
    torch.testing.assert_close(mixture.weights, torch.tensor([10.0, *[2.0] * len(earlier)]) / len(rows))


@pytest.mark.parametrize("wrong", [{"replay": -1}, {"replay_stride": 0}])
def test_a_replay_that_is_none_is_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        AirlConfiguration(**wrong)


def test_replayed_samples_do_not_move_the_reward_of_an_expert_that_is_matched():
    """Expert and replay are both π_0, the learner has moved on: r must be log π_0 wherever the samples are.

    With the present policy's density instead of the mixture's, r would lie between log π_0 and log π_1.
    """
    count, generator = 20000, torch.Generator().manual_seed(1)
    policies = [GaussianPolicy(np.ones(2), 1, hidden=4, log_std=0.0, seed=0) for _ in range(2)]
    policies[1].network.layers[-1][1].fill_(1.5)  # the mean of the present one

    def drawn(policy, rows):
        o = torch.randn(rows, 2, generator=generator)
        return torch.cat([o, policy.network.value(o) + torch.randn(rows, 1, generator=generator)], dim=1)

    expert = drawn(policies[0], count)
    own = torch.cat([drawn(policies[1], count // 2), drawn(policies[0], count // 2)])
    found = {}
    for name, mixture in {"mixture": policies, "present": policies[1:]}.items():
        density = Mixture(mixture, torch.full((len(mixture),), 1.0 / len(mixture))).log_density
        reward = RewardNetwork(2, 1, seed=0)
        for rate in (3e-3, 5e-4):
            train_discriminator(
                reward,
                (expert, density(expert), np.zeros(count, dtype=int)),
                (own, density(own), np.zeros(count, dtype=int)),
                slope_bound=1e9,
                learning_rate=rate,
                configuration=DiscriminatorConfiguration(steps=800, penalty=0.0),
                rng=np.random.default_rng(2),
            )
        tried = drawn(policies[0], 2000)
        truth = Mixture(policies[:1], torch.ones(1)).log_density(tried)
        found[name] = float((reward.value(tried) - truth).square().mean().sqrt())
    assert found["mixture"] < 0.16, found
    assert found["present"] > 3 * found["mixture"]


def test_a_reward_judges_the_newest_observation():
    """With a history it learns, bit for bit, what it learns without, given the same densities."""
    generator, rng = torch.Generator().manual_seed(3), np.random.default_rng
    task = tasks.make("peg-in-hole", history=3)
    pools = [
        (
            torch.randn(600, task.observation_size + 6, generator=generator),
            torch.randn(600, generator=generator),
            np.arange(600) % 3,
        )
        for _ in range(2)
    ]
    learned = []
    for columns in (slice(None), slice(24, None)):
        reward = RewardNetwork.for_task(task, seed=1)
        assert reward.network.sizes[0] == 18
        train_discriminator(
            reward,
            *[(samples[:, columns], log, strata) for samples, log, strata in pools],
            slope_bound=4.0,
            learning_rate=3e-3,
            configuration=DiscriminatorConfiguration(steps=5),
            rng=rng(0),
        )
        learned.append(reward)
    torch.testing.assert_close(learned[0].theta, learned[1].theta, rtol=0, atol=0)
    samples = pools[0][0]
    torch.testing.assert_close(learned[0].value(samples), learned[0].value(samples[:, 24:]))
    for columns in (slice(25, None), slice(1, None)):
        with pytest.raises(InputError, match="judges 12 of an observation and 6 of an action"):
            learned[0].value(samples[:, columns])


def run(learner, iterations: int) -> dict[str, torch.Tensor]:
    for _ in range(iterations):
        learner.iterate()
    return learner.state()


def assert_same(left: dict[str, torch.Tensor], right: dict[str, torch.Tensor]) -> None:
    assert left.keys() == right.keys()
    for name in left:
        assert torch.equal(left[name], right[name]), name


@pytest.mark.parametrize(
    "changes",
    [{}, {"replay": 3}, {"expert_noise": 0.0}, {"restart_after": 4, "restart_above": 0.0, "restarts": 1}],
)
def test_a_resumed_run_equals_the_unbroken_one(tmp_path, changes):
    environment = ToyEnvironment()
    expert = toy_expert(environment)
    settings = replace(SETTINGS, **changes)

    def fresh(seed: int) -> Airl:
        return Airl(environment, expert, configuration=settings, seed=seed)

    unbroken = run(fresh(3), 9)
    assert_same(run(fresh(3), 9), unbroken)
    for stop in (1, 4, 5, 8):
        broken = fresh(3)
        run(broken, stop)
        path = tmp_path / f"{stop}.safetensors"
        save_tensors(path, broken.state(), {"kind": "checkpoint"})
        resumed = fresh(3)
        resumed.load_state(load_tensors(path, kind="checkpoint")[0])
        assert_same(run(resumed, 9 - stop), unbroken)
    assert not torch.equal(run(fresh(4), 9)["search.policy"], unbroken["search.policy"])


def test_a_resumed_transfer_equals_the_unbroken_one(tmp_path):
    environment = ToyEnvironment()
    reward = RewardNetwork(4, 2, seed=0)
    settings = TransferConfiguration(iterations=6, search=SEARCH)

    def fresh() -> Transfer:
        return Transfer(environment, reward, fresh_policy(environment), configuration=settings, seed=2)

    unbroken = run(fresh(), 6)
    broken = fresh()
    run(broken, 2)
    path = tmp_path / "checkpoint.safetensors"
    save_tensors(path, broken.state(), {"kind": "checkpoint"})
    resumed = fresh()
    resumed.load_state(load_tensors(path, kind="checkpoint")[0])
    assert_same(run(resumed, 4), unbroken)


def test_the_trained_policy_anchors_its_transfer():
    """Maximised is (r + w log π₀)/(1 + w) − log π: a wrong reward moves the policy, and the less the larger w."""
    environment = ToyEnvironment()
    trained, wrong = fresh_policy(environment), RewardNetwork(4, 2, seed=5)

    def transfer(anchor: float, *, fresh: bool = False) -> Transfer:
        settings = TransferConfiguration(iterations=15, anchor=anchor, fresh=fresh, search=SEARCH)
        return Transfer(environment, wrong, trained, configuration=settings, seed=2)

    def moved(anchor: float) -> float:
        learner = transfer(anchor)
        run(learner, 15)
        inputs = torch.randn(500, 4, generator=torch.Generator().manual_seed(0))
        change = learner.result().network.value(inputs) - trained.network.value(inputs)
        return float(change.square().mean().sqrt())

    far, near, nearest = moved(0.0), moved(1.0), moved(30.0)
    assert far > 1.2 * near > 1.2 * 1.2 * nearest

    learner = transfer(3.0)
    batch = learner.search.sample(0)
    density = torch.distributions.Normal(trained.network.value(batch.steps), trained.log_std.exp())
    log = density.log_prob(batch.actions).sum(1)
    torch.testing.assert_close(learner._value(batch), (wrong.value(batch.samples) + 3.0 * log) / 4.0)
    fresh = transfer(3.0, fresh=True)
    batch = fresh.search.sample(0)
    torch.testing.assert_close(fresh._value(batch), wrong.value(batch.samples))


def test_policy_and_reward_survive_the_disk(tmp_path):
    environment = ToyEnvironment()
    policy, reward = fresh_policy(environment, seed=9), RewardNetwork(4, 2, seed=9)
    save_policy(tmp_path / "policy.safetensors", policy)
    save_reward(tmp_path / "reward.safetensors", reward)
    loaded = load_policy(tmp_path / "policy.safetensors")
    assert torch.equal(loaded.theta, policy.theta)
    np.testing.assert_array_equal(loaded.observation_scale, policy.observation_scale)
    assert torch.equal(load_reward(tmp_path / "reward.safetensors").theta, reward.theta)
    save_policy(tmp_path / "again.safetensors", policy)
    assert (tmp_path / "again.safetensors").read_bytes() == (tmp_path / "policy.safetensors").read_bytes()


def test_damaged_weight_files_are_refused(tmp_path):
    policy = fresh_policy(ToyEnvironment())
    good = tmp_path / "policy.safetensors"
    save_policy(good, policy)
    with pytest.raises(FileError, match="not a reward file"):
        load_reward(good)
    with pytest.raises(FileError, match=r"missing|cannot be read"):
        load_policy(tmp_path / "nowhere.safetensors")
    content = good.read_bytes()
    for length in itertools.chain(range(0, 400, 37), [len(content) - 1]):
        broken = tmp_path / "broken.safetensors"
        broken.write_bytes(content[:length])
        with pytest.raises(FileError):
            load_policy(broken)
    policy.theta[0] = float("nan")
    save_policy(good, policy)
    with pytest.raises(FileError, match="not finite"):
        load_policy(good)
    save_tensors(good, {"layer_0.weight": torch.zeros(2, 2)}, {"kind": "policy", "sizes": [4, 32, 32, 2]})
    with pytest.raises(FileError, match="train it again"):
        load_policy(good)


def test_expert_data_refuses_bad_splits():
    policy = fresh_policy(ToyEnvironment())
    observations, actions = np.zeros((5, 7, 4)), np.zeros((5, 6, 2))
    given = {"policy": policy, "bounds": (-np.ones(2), np.ones(2))}
    data = ExpertData.from_trajectories(observations, actions, held_out=2, **given)
    assert len(data.training[0]) == 18
    assert len(data.held_out[0]) == 12
    with pytest.raises(InputError, match="held_out"):
        ExpertData.from_trajectories(observations, actions, held_out=5, **given)
    spoilt = observations.copy()
    spoilt[3, 2, 1] = np.nan
    with pytest.raises(InputError, match=r"\[3, 2, 1\]"):
        ExpertData.from_trajectories(spoilt, actions, **given)
    with pytest.raises(InputError, match="metres"):
        ExpertData.from_trajectories(observations + 300.0, actions, **given)
    with pytest.raises(InputError, match="shape"):
        ExpertData.from_trajectories(observations[..., :3], actions, **given)
    with pytest.raises(InputError, match="agree"):
        ExpertData.from_trajectories(observations[:4], actions, **given)


def test_demonstrations_become_rows_of_their_own_task():
    task = tasks.make("cup-on-plate", action="force")
    shown = tasks.record(task, 3, seed=1)
    policy = GaussianPolicy.for_task(task, hidden=8, log_std=0.0, seed=0)
    data = ExpertData.from_demonstrations(shown, task, policy=policy, held_out=1)
    assert data.training[0].shape == (2 * task.horizon, task.observation_size)
    assert data.held_out[1].shape == (task.horizon, task.action_size)
    np.testing.assert_array_equal(data.high.numpy(), np.full(6, 40.0, dtype=np.float32))
    with pytest.raises(InputError, match=r"action force, history 1; the task is cup-on-plate, action gain"):
        ExpertData.from_demonstrations(shown, tasks.make("cup-on-plate"), policy=policy)
