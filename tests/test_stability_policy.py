"""Policies: known answers, gradients against calculus, and never a proof that the policy does not deserve."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vic_toolbox.control import ConstantGains, ThreePhaseExpert, TipStiffnessExpert
from vic_toolbox.errors import InputError
from vic_toolbox.gains import DampingFactor, DiagonalStiffness, ImpedanceGains
from vic_toolbox.learning import GaussianPolicy
from vic_toolbox.models import load_robot
from vic_toolbox.stability.policies import held_force
from vic_toolbox.stability.policies.loop_energy import loop_energy
from vic_toolbox.stability.policies.policy import policy_stability
from vic_toolbox.stability.policies.policy_jacobian import policy_jacobian
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.policies.policy_range import range_certificate
from vic_toolbox.stability.policies.region_of_attraction import lyapunov_matrix, region_of_attraction
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

seeds = st.integers(0, 2**32 - 1)


def bell(peak: float = 1000.0, width: float = 0.01):
    """POL1: a stiffness that falls with the error."""
    return lambda x: peak * np.exp(-(x[:, 0] ** 2) / (2 * width**2))


def fading(k: float = 1000.0, slope: float = 1500.0, b: float = 20.0):
    """POL2: a stiffness that falls with the speed."""
    return lambda x: (k - slope * x[:, 1], b)


def grows_when_replayed(verdict: Verdict) -> bool:
    """By our own integration of the policy, not by the example's."""
    example = verdict.witness
    assert isinstance(example, CounterExample)
    t, state = example.replay()
    assert len(t) == len(example.time)
    assert np.linalg.norm(state[-1]) > 2 * np.linalg.norm(state[0])
    return example.energy[-1] > 4 * example.energy[0]


# ------------------------------------------------------------------------------------------------ known answers


def test_pol1_holds_six_newtons_and_pushes_beyond():
    verdict = policy_stability(bell(), 1.0, damping=20.0, region=[0.03, 0.3])
    assert verdict.values["largest_force"] == pytest.approx(6.06531, abs=5e-6)
    assert abs(verdict.values["largest_force_error"]) == pytest.approx(0.01, rel=1e-5)
    assert verdict.values["largest_force_at_edge"] is False
    assert verdict.values["effective_stiffness"] == pytest.approx(-2000 * np.exp(-1.5), rel=1e-2)
    loop = PolicyLoop(bell(), 1.0, damping=20.0)
    e = np.array([0.005, 0.0099, 0.01, 0.0101, 0.02])
    found = policy_jacobian(loop, np.stack([e, 0 * e], axis=1), scale=np.array([0.01, 0.1]))
    exact = 1000 * np.exp(-(e**2) / 2e-4) * (1 - e**2 / 1e-4)
    np.testing.assert_allclose(found.softest, exact, atol=1e-5)
    assert (np.sign(found.softest.round(4)) == [1, 1, 0, -1, -1]).all()


@pytest.mark.parametrize(
    ("load", "status"),
    [(0.0, "proved"), (6.0, "proved"), (-6.0, "proved"), (6.1, "disproved"), (-7, "disproved")],
)
def test_pol1_under_a_load(load: float, status: str):
    verdict = policy_stability(bell(), 1.0, damping=20.0, load=load)
    assert verdict.status == status
    if status == "proved":
        e = verdict.values["equilibrium"]
        assert 1000 * np.exp(-(e**2) / 2e-4) * e == pytest.approx(load)
        assert "(local)" in verdict.question
    else:
        assert grows_when_replayed(verdict)


def test_pol1_in_a_region_that_reaches_too_far():
    """Under 5 N the arm is held, unless it starts beyond the second equilibrium."""
    verdict = policy_stability(bell(), 1.0, damping=20.0, load=5.0, region=[0.03, 0.3])
    assert verdict.status == "disproved"
    assert grows_when_replayed(verdict)
    near = policy_stability(bell(), 1.0, damping=20.0, load=5.0, region=[0.009, 0.02])
    assert near.status == "inconclusive", "samples prove nothing"
    assert isinstance(near.witness, Certificate)
    assert near.values["search_settled"] > 0.5
    assert near.values["attraction_share"] > 0.9


@pytest.mark.parametrize("region", [None, [0.05, 0.4]])
def test_pol2_grows_although_every_stiffness_is_positive(region: list[float] | None):
    verdict = policy_stability(fading(), 1.0, load=20.0, region=region)
    assert verdict.status == "disproved"
    assert verdict.values["equilibrium"] == pytest.approx(0.02)
    assert verdict.values["growth_rate"] == pytest.approx(5.0, rel=1e-6)
    assert verdict.margin == pytest.approx(-5.0, rel=1e-6)
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.gains["stiffness"].min() > 0
    assert grows_when_replayed(verdict)


@pytest.mark.parametrize("load", [10.0, 13.0, 14.0, 30.0])
def test_pol2_at_other_loads(load: float):
    """Effective damping 20 − 1.5 F: the edge is at 13.333 N."""
    verdict = policy_stability(fading(), 1.0, load=load)
    rate = -(20.0 - 1.5 * load) / 2
    assert verdict.values["growth_rate"] == pytest.approx(rate, rel=1e-6)
    assert verdict.status == ("disproved" if rate > 0 else "inconclusive")
    if rate < 0:
        assert "negative" in verdict.reason, (
            "its stiffness turns negative at 0.67 m/s: nothing is proved of it"
        )
        bounded = policy_stability(lambda x: (np.maximum(1000 - 1500 * x[:, 1], 1.0), 20.0), 1.0, load=load)
        assert bounded.status == "proved"


@settings(max_examples=12)
@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(1e-2, 1e2))
def test_units_change_no_verdict(force: float, length: float, duration: float):
    """The same policies in other units of force, length and time."""
    k, b, m = force / length, force * duration / length, force * duration**2 / length
    in_speed = lambda x: ((1000 - 1500 * x[:, 1] * duration / length) * k, 20 * b)  # noqa: E731
    verdict = policy_stability(in_speed, m, load=20 * force)
    assert verdict.status == "disproved"
    assert verdict.values["growth_rate"] * duration == pytest.approx(5.0, rel=1e-4)
    in_error = lambda x: (1000 * k * np.exp(-((x[:, 0] / length) ** 2) / 2e-4), 20 * b)  # noqa: E731
    assert policy_stability(in_error, m, load=6.0 * force).status == "proved"
    assert policy_stability(in_error, m, load=6.1 * force).status == "disproved"


# ------------------------------------------------------------------------------------------------- derivatives


def coupled(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Full gains of two axes, smooth functions of error and rate."""
    a, b, v, w = x.T
    k = np.empty((len(x), 2, 2))
    k[:, 0, 0], k[:, 1, 1] = 300 + 100 * np.sin(20 * b), 400 + 50 * np.tanh(v)
    k[:, 0, 1] = k[:, 1, 0] = 30 * np.cos(10 * a) * np.tanh(w)
    return k, np.stack([20 + 5 * np.sin(10 * a), 30 + 3 * np.tanh(v) * np.tanh(w)], axis=1)


@given(seeds)
def test_effective_gains_are_the_derivatives_of_the_wrench(seed: int):
    loop = PolicyLoop(coupled, np.array([[2.0, 0.3], [0.3, 1.0]]))
    states = np.random.default_rng(seed).uniform(-1, 1, (5, 4)) * [0.05, 0.05, 0.3, 0.3]
    found = policy_jacobian(loop, states, scale=np.array([0.05, 0.05, 0.3, 0.3]))
    for j in range(4):
        h = 1e-6 * np.eye(4)[j]
        slope = (loop(states + h).pull(states + h) - loop(states - h).pull(states - h)) / 2e-6
        whole = np.concatenate([found.effective_stiffness, found.effective_damping], axis=2)
        np.testing.assert_allclose(whole[:, :, j], slope, rtol=1e-5, atol=1e-4)


def test_stiffness_rate_is_the_total_derivative():
    """Along the motion itself: ∂K/∂e ė + ∂K/∂ė ë, against differences of K in time."""
    loop = PolicyLoop(coupled, np.array([[2.0, 0.3], [0.3, 1.0]]))
    start = np.array([0.04, -0.03, 0.2, 0.1])
    motion = solve_ivp(
        lambda _, x: loop.derivative(x[None])[0], (0, 0.3), start, rtol=1e-11, atol=1e-13, dense_output=True
    )
    t, h = np.linspace(0.01, 0.29, 9), 1e-5
    found = policy_jacobian(loop, motion.sol(t).T, scale=np.array([0.05, 0.05, 0.3, 0.3]))
    for gain, rate in (("stiffness", found.stiffness_rate), ("damping", found.damping_rate)):
        ahead, behind = (getattr(loop(motion.sol(t + s).T), gain) for s in (h, -h))
        np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), atol=2e-3 * np.abs(rate).max())


def test_single_precision_is_noticed():
    """A network in float32 differentiated with the steps of float64 would give noise."""
    weights = np.random.default_rng(0).normal(size=(2, 8))

    def smooth(x: np.ndarray, kind: type = np.float64) -> np.ndarray:
        hidden = np.tanh((x / [0.1, 0.5]).astype(kind) @ weights.astype(kind))
        return 300 + 100 * hidden.sum(axis=1)

    states, scale = np.array([[0.03, 0.1], [-0.05, 0.2]]), np.array([0.1, 0.5])
    exact = policy_jacobian(PolicyLoop(smooth, 1.0, damping=20.0), states, scale=scale)
    rough = policy_jacobian(
        PolicyLoop(lambda x: smooth(x, np.float32), 1.0, damping=20.0), states, scale=scale
    )
    np.testing.assert_allclose(rough.effective_stiffness, exact.effective_stiffness, rtol=1e-3)
    error = np.abs(rough.effective_stiffness - exact.effective_stiffness)
    assert (error <= rough.uncertainty[..., :1] + 1e-9).all()


# ---------------------------------------------------------------------------- a spring without a potential


def test_a_loop_gives_the_energy_of_its_curl():
    """k₁ = k + c e₂ is diagonal and positive; w = (k e₁ + c e₁e₂, k e₂) has the curl ∂w₁/∂e₂ = c e₁."""
    c = 2000.0
    loop = PolicyLoop(
        lambda x: (np.stack([500 + c * x[:, 1], 500 + 0 * x[:, 1]], axis=1), [20.0, 20.0]), np.eye(2)
    )
    centre, radius = np.array([0.05, 0.0]), np.array([0.02, 0.03])
    turn = loop_energy(loop, centre, radius=radius)
    # ∮ c e₁ e₂ de₁ = −∬ c e₁ dA = −c ē₁ π r₁ r₂
    assert turn.energy == pytest.approx(c * 0.05 * np.pi * 0.02 * 0.03)
    assert turn.plane == (0, 1)
    found = policy_jacobian(loop, np.array([[0.05, 0.0, 0.0, 0.0]]), scale=np.full(4, 0.05))
    assert found.curl[0] == pytest.approx(c * 0.05, rel=1e-6)
    assert loop_energy(loop, np.zeros(2), radius=radius).energy == pytest.approx(0, abs=1e-12)


def test_gains_of_each_axis_alone_have_a_potential():
    loop = PolicyLoop(lambda x: (300 + 1e4 * x[:, :2] ** 2, 20.0 + 0 * x[:, :2]), np.eye(2))
    assert loop_energy(loop, np.array([0.02, 0.01]), radius=np.array([0.05, 0.05])).energy < 1e-12


def swirl(strength: float):
    """A wrench with a skew part: the plain non-conservative spring."""
    skew = np.array([[0.0, strength], [-strength, 0.0]])
    return lambda x: -(400 * x[:, :2] + x[:, :2] @ skew.T) - 4.0 * x[:, 2:]


@pytest.mark.parametrize(("strength", "status"), [(70.0, "inconclusive"), (90.0, "disproved")])
def test_a_swirling_wrench_needs_damping(strength: float, status: str):
    """m s² + b s + k ± i c: stable iff b > c √(m/k), here c < 4 · 20 = 80."""
    verdict = policy_stability(swirl(strength), np.eye(2), output="wrench", region=[0.1, 0.1, 1.0, 1.0])
    assert verdict.status == status
    assert verdict.values["curl"] == pytest.approx(2 * strength, rel=1e-6)
    assert verdict.values["loop_energy"] == pytest.approx(2 * strength * np.pi * 0.05**2, rel=1e-6)
    if status == "disproved":
        assert grows_when_replayed(verdict)


# --------------------------------------------------------------------------------- regions, and honest searches


def test_growth_that_hides_from_the_linearisation():
    """Negative damping beyond 0.3 m/s: stable near the goal, and thrown out from fast starts."""

    def policy(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.full(len(x), 100.0), np.full(len(x), 2.0)

    def pushed(x: np.ndarray) -> np.ndarray:
        e, v = x.T
        return -(100 * e + 2.0 * v * (1 - (v / 0.3) ** 2))[:, None]

    assert policy_stability(policy, 1.0, region=[0.1, 1.0]).status == "inconclusive"
    assert policy_stability(pushed, 1.0, output="wrench", region=[0.01, 0.1]).status == "inconclusive"
    far = policy_stability(pushed, 1.0, output="wrench", region=[0.1, 1.0])
    assert far.status == "disproved"
    assert far.values["growth_rate"] == pytest.approx(-1.0, rel=1e-3)
    assert far.values["attraction_share"] < 0.5
    assert grows_when_replayed(far)


@settings(max_examples=20)
@given(seeds)
def test_passive_policies_are_never_disproved(seed: int):
    """Each axis' stiffness depends on its own error, damping is positive: energy falls, whatever happens on the way."""
    generator = np.random.default_rng(seed)
    low, high, width, b = generator.uniform([1, 100, 0.01, 0.5], [50, 3000, 0.1, 40])

    def policy(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return low + (high - low) * np.exp(-((x[:, 0] / width) ** 2)), b * (1 + (x[:, 1] / 0.2) ** 2)

    mass = generator.uniform(0.5, 5.0)
    for policy_ in (policy, lambda x: (high + low - policy(x)[0], b)):
        verdict = policy_stability(policy_, mass, region=[0.2, 1.0], seed=seed % 1000)
        assert verdict.status == "inconclusive"
        assert policy_stability(policy_, mass).status == "proved"


@settings(max_examples=20)
@given(seeds)
def test_a_local_proof_keeps_its_word(seed: int):
    """In a small ellipsoid of P every motion of a proved policy decays: P, not only its eigenvalues, is right."""
    generator = np.random.default_rng(seed)
    loop = PolicyLoop(coupled, np.array([[2.0, 0.3], [0.3, 1.0]]))
    verdict = policy_stability(coupled, loop.mass)
    assert isinstance(verdict.witness, Certificate)
    p = verdict.witness.values["P"]
    x = np.linalg.solve(np.linalg.cholesky(p).T, generator.normal(size=4))
    x *= 1e-4 / np.abs(x).max()
    motion = solve_ivp(
        lambda _, x: loop.derivative(x[None])[0], (0, 3), x, rtol=1e-10, atol=1e-16, max_step=0.01
    )
    stored = np.einsum("it,ij,jt->t", motion.y, p, motion.y)
    assert (np.diff(stored) < 0).all()


def test_region_of_attraction_ends_where_the_policy_lets_go():
    """k = 100 (1 − (e/0.1)²) without load: the barrier is at e = 0.1, and no ellipsoid may reach beyond."""
    loop = PolicyLoop(lambda x: (100 * (1 - (x[:, 0] / 0.1) ** 2), 5.0), 1.0)
    system = np.array([[0.0, 1.0], [-100.0, -5.0]])
    p = lyapunov_matrix(system, normal=loop.normal(10.0))
    found = region_of_attraction(
        loop, np.zeros(1), p, region=np.array([0.3, 3.0]), generator=np.random.default_rng(0)
    )
    assert 0.2 < found.semi_axes[0] / 0.1 <= 1.0
    assert found.level > 0
    np.testing.assert_allclose(system.T @ p + p @ system, -np.diag([100.0, 1.0]), atol=1e-9)


def test_the_load_that_is_held_in_several_axes():

    def policy(x):
        return 1000 * np.exp(-(x[:, :2] ** 2) / [2e-4, 8e-4]), [20.0, 20.0]

    loop = PolicyLoop(policy, np.eye(2))
    held = held_force.largest_force(loop, reach=np.array([0.05, 0.015]))
    assert held.force[0] == pytest.approx(6.06531, abs=5e-6)
    assert list(held.at_edge) == [False, True]
    rest = held_force.equilibrium(PolicyLoop(policy, np.eye(2), load=[3.0, -5.0]))
    assert rest is not None
    np.testing.assert_allclose(1000 * np.exp(-(rest**2) / [2e-4, 8e-4]) * rest, [3.0, -5.0])


# ------------------------------------------------------------------------------------- policies of the toolbox

RANGE = DampingFactor(
    stiffness_low=(60.0, 60.0, 60.0, 1.0, 1.0, 1.0),
    stiffness_high=(200.0, 200.0, 200.0, 6.0, 6.0, 6.0),
    factor_low=9.0,
    factor_high=12.0,
    rotational_damping=20.0,
)
BODY = np.diag([5.0] * 3 + [0.1] * 3)


def learned(hidden: int = 32, *, history: int = 1) -> GaussianPolicy:
    scale = np.tile([0.3] * 3 + [0.5] * 3 + [0.5] * 3 + [1.0] * 3, history)
    policy = GaussianPolicy(scale, 7, hidden=hidden, log_std=-1.0, seed=0)
    generator = np.random.default_rng(1)
    policy.theta.copy_(policy.theta.new_tensor(0.3 * generator.normal(size=len(policy.theta))))
    return policy


def rollout(count: int = 200, *, history: int = 1) -> np.ndarray:
    decay = np.exp(-np.linspace(0, 4, count))[:, None]
    states = np.hstack(
        [decay * [0.5, 0.2, -0.3, 0.3, 0.2, 0.1], -2 * decay * [0.5, 0.2, -0.3, 0.3, 0.2, 0.1]]
    )
    return np.tile(states, (1, history))


def test_a_learned_rollout_is_analysed_within_two_seconds():
    arm = load_robot("fanuc_lrmate200id7l", tool="cup_gripper")
    mass = arm.operational_space(arm.home, np.zeros(6)).mass
    begin = time.process_time()  # of this work alone, whatever else the machine does
    verdict = policy_stability(learned(), mass, parametrisation=RANGE, rollout=rollout())
    assert time.process_time() - begin < 2.0
    assert verdict.status == "inconclusive"
    assert verdict.values["curl"] > 0
    assert np.isfinite(verdict.values["rollout_stiffness_power"])
    assert verdict.values["inadmissible_share"] == 0
    assert isinstance(verdict.witness, Certificate)


def test_a_policy_with_bounded_gains_on_a_body_is_proved_by_its_range():
    pytest.importorskip("cvxpy")
    verdict = policy_stability(learned(), BODY, parametrisation=RANGE, rollout=rollout(20))
    assert verdict.status == "proved"
    assert "anywhere" in verdict.question
    assert verdict.margin > 0
    remembering = policy_stability(learned(history=2), BODY, parametrisation=RANGE, history=2)
    assert remembering.status == "proved", (
        "within its range the gains may do anything, so memory does not matter"
    )
    heavy, coupled_mass = np.diag([5e4] * 3 + [0.1] * 3), BODY + 0.01
    assert range_certificate(PolicyLoop(learned(), heavy, parametrisation=RANGE)) is None
    assert range_certificate(PolicyLoop(learned(), coupled_mass, parametrisation=RANGE)) is None


def test_tensors_networks_and_plain_functions_are_one_policy():
    torch = pytest.importorskip("torch")
    policy = learned()
    states = rollout(5)
    reference = PolicyLoop(policy, BODY, parametrisation=RANGE)(states)
    network = torch.nn.Sequential(torch.nn.Linear(12, 7), torch.nn.Tanh())
    for given_ in (policy.mean, lambda x: torch.tensor(policy.mean(x), requires_grad=True)):
        answer = PolicyLoop(given_, BODY, parametrisation=RANGE)(states)
        np.testing.assert_array_equal(answer.stiffness, reference.stiffness)
        assert answer.precision > 1e-8
    with torch.no_grad():
        action = network(torch.as_tensor(states, dtype=torch.float32)).numpy()
    answer = PolicyLoop(network, BODY, parametrisation=RANGE)(states)
    np.testing.assert_allclose(answer.stiffness, RANGE.to_gains(action).stiffness)


def test_forms_of_gains_agree():
    states = np.random.default_rng(0).normal(size=(5, 2))
    k = 100 + states[:, 0] ** 2
    forms = {
        "pair": lambda x: (100 + x[:, 0] ** 2, 7.0),
        "two arrays": lambda e, v: (100 + e**2, 7.0 + 0 * v),
        "columns": lambda x: (100 + x[:, :1] ** 2, np.full((len(x), 1), 7.0)),
        "one array": lambda x: np.stack([100 + x[:, 0] ** 2, np.full(len(x), 7.0)], axis=1),
        "matrices": lambda x: (100 + x[:, :1, None] ** 2, np.full((len(x), 1, 1), 7.0)),
    }
    for name, policy in forms.items():
        answer = PolicyLoop(policy, 2.0)(states)
        np.testing.assert_allclose(answer.stiffness[:, 0, 0], k, err_msg=name)
        np.testing.assert_allclose(answer.damping[:, 0, 0], 7.0, err_msg=name)
    answer = PolicyLoop(lambda x: 100 + x[:, 0] ** 2, 2.0, damping=7.0)(states)
    np.testing.assert_allclose(answer.stiffness[:, 0, 0], k)
    gains = ImpedanceGains.diagonal([100.0] * 6, [10.0] * 6)
    answer = PolicyLoop(lambda x: gains, BODY)(np.zeros((3, 12)))
    np.testing.assert_allclose(answer.stiffness, np.tile(100 * np.eye(6), (3, 1, 1)))


def test_the_experts_of_the_toolbox():
    """Their gains depend on the error; the paper's peg expert couples a tilt into the stiffness along x."""
    peg = DiagonalStiffness(
        stiffness_low=(10.0, 10.0, 10.0, 0.5, 0.5, 0.5),
        stiffness_high=(1000.0, 1000.0, 1000.0, 15.0, 15.0, 15.0),
        damping=(60.0, 60.0, 60.0, 2.0, 2.0, 2.0),
    )
    tip = TipStiffnessExpert(
        parametrisation=peg, offset=(0.0, 0.0, -0.1), tip_stiffness=[500.0, 500.0, 500.0, 5.0, 5.0, 5.0]
    )
    region = [0.01] * 3 + [0.1] * 3 + [0.05] * 3 + [0.5] * 3
    verdict = policy_stability(tip, BODY, region=region)
    assert verdict.values["curl"] > 1
    assert verdict.values["loop_energy"] > 0
    for expert in (ConstantGains(parametrisation=peg), ThreePhaseExpert(parametrisation=RANGE)):
        verdict = policy_stability(expert, BODY, region=region)
        assert verdict.status == "inconclusive"
        assert verdict.values["search_growth"] < 1


def test_memory_is_not_judged():
    verdict = policy_stability(lambda x: (np.full(len(x), 100.0), 10.0), 1.0, history=5)
    assert verdict.status == "inconclusive"
    assert "memory" in verdict.reason


# -------------------------------------------------------------------------------------------------- bad policies


REGIONS = pytest.mark.parametrize("region", [None, [0.05, 0.5]])


@REGIONS
@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (lambda x: (np.full(len(x), -100.0), 10.0), "positive at the equilibrium"),
        (lambda x: (np.zeros(len(x)), 10.0), "positive at the equilibrium"),
        (lambda x: (np.full(len(x), 100.0), -1.0), "positive at the equilibrium"),
        (lambda x: (np.full(len(x), np.nan), 10.0), "stiffness is nan"),
        (lambda x: (np.full(len(x), 100.0), np.inf), "damping is inf"),
    ],
)
def test_gains_that_are_never_right_are_refused(policy, message: str, region: list[float] | None):
    with pytest.raises(InputError, match=message):
        policy_stability(policy, 1.0, region=region)


@REGIONS
@pytest.mark.parametrize(
    "policy",
    [
        lambda x: (100 - 1e4 * x[:, 0], 10.0),
        lambda x: (100 - 300 * x[:, 1], 10.0),
        lambda x: (100.0, 10 - 1e3 * np.abs(x[:, 0])),
        lambda x: (np.where(np.abs(x[:, 0]) < 1e-3, 100.0, -5.0), 10.0),
    ],
)
def test_gains_that_turn_negative_prove_nothing(policy, region: list[float] | None):
    verdict = policy_stability(policy, 1.0, region=region)
    assert verdict.status == "inconclusive"
    assert "gains are negative" in verdict.reason


def test_gains_that_are_missing_somewhere_prove_nothing():
    """Without a region it is the far away that is not defined, with one it is an error."""

    def policy(x: np.ndarray) -> tuple[np.ndarray, float]:
        return np.where(np.abs(x[:, 0]) > 0.01, np.nan, 100.0), 10.0

    verdict = policy_stability(policy, 1.0)
    assert verdict.status == "inconclusive"
    assert "nan" in verdict.reason
    assert policy_stability(policy, 1.0, region=[0.005, 0.01]).status == "inconclusive"
    with pytest.raises(InputError, match="nan"):
        policy_stability(policy, 1.0, region=[0.05, 0.5])


def test_a_jump_at_the_equilibrium_proves_nothing():
    verdict = policy_stability(lambda x: (np.where(x[:, 0] > 0, 400.0, 100.0), 10.0), 1.0)
    assert verdict.status == "inconclusive"
    assert "jump" in verdict.reason


def test_a_kink_at_the_equilibrium_proves_nothing():
    verdict = policy_stability(lambda x: (1000 - 8e4 * np.maximum(x[:, 0] - 0.02, 0), 20.0), 1.0, load=20.0)
    assert verdict.status == "inconclusive"


def test_at_the_edge_nothing_is_claimed():
    assert policy_stability(lambda x: (np.full(len(x), 100.0), 0.0), 1.0).status == "inconclusive"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: policy_stability(7, 1.0), "function"),
        (lambda: policy_stability(bell(), -1.0, damping=1.0), "mass"),
        (lambda: policy_stability(bell(), [1.0, 2.0], damping=1.0), "mass"),
        (lambda: policy_stability(bell(), 1.0), "without damping"),
        (lambda: policy_stability(bell(), 1.0, damping=-1.0), "damping"),
        (lambda: policy_stability(fading(), 1.0, damping=1.0), "leave out damping"),
        (lambda: policy_stability(fading(), 1.0, load=[1.0, 2.0]), "load"),
        (lambda: policy_stability(fading(), 1.0, region=[0.1]), "region"),
        (lambda: policy_stability(fading(), 1.0, region=[0.1, -1.0]), "region"),
        (lambda: policy_stability(fading(), 1.0, rollout=np.zeros((0, 2))), "rollout"),
        (lambda: policy_stability(fading(), 1.0, rollout=np.zeros((5, 2))), "move"),
        (lambda: policy_stability(fading(), 1.0, rollout=np.full((5, 2), np.nan)), "rollout"),
        (lambda: policy_stability(fading(), 1.0, samples=0), "samples"),
        (lambda: policy_stability(fading(), 1.0, history=0), "history"),
        (lambda: policy_stability(fading(), 1.0, output="torque"), "wrench"),  # type: ignore[arg-type]
        (lambda: policy_stability(lambda x: -x[:, :1], 1.0, output="wrench"), "region"),
        (
            lambda: policy_stability(lambda x: np.zeros((len(x), 3)), 1.0, output="wrench", region=[1, 1]),
            "wrench",
        ),
        (lambda: policy_stability(lambda x: (np.zeros((len(x), 3)), 1.0), 1.0), "shape"),
        (lambda: policy_stability(lambda x: ("stiff", 1.0), 1.0), "real numbers"),
        (lambda: policy_stability(lambda x: 1 / 0, 1.0), "failed"),
        (lambda: policy_stability(lambda x: (1.0, 2.0, 3.0), 1.0), "3 arrays"),
        (
            lambda: policy_stability(lambda x: (np.triu(np.ones((len(x), 2, 2))), [1.0, 1.0]), np.eye(2)),
            "symmetric",
        ),
        (lambda: policy_stability(learned(), 1.0, parametrisation=RANGE), "six axes"),
        (lambda: policy_stability(learned(), BODY, parametrisation=RANGE, damping=1.0), "damping"),
        (lambda: policy_stability(lambda x: x, BODY, parametrisation=RANGE), "actions"),
    ],
)
def test_bad_input_is_refused(call, message: str):
    with pytest.raises(InputError, match=message):
        call()


def test_a_verdict_can_be_saved(tmp_path):
    for verdict in (
        policy_stability(fading(), 1.0, load=20.0),
        policy_stability(bell(), 1.0, damping=20.0, region=[0.03, 0.3]),
    ):
        verdict.save(tmp_path / "verdict.json")
        assert verdict.status.upper() in verdict.summary()
