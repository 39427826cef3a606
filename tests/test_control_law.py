"""The law makes every arm the mass, spring and damper that it promises, by Pinocchio's dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import simpson

from tests.arms import (
    ARMS,
    arm,
    random_gains,
    random_reference,
    random_states,
    task_acceleration,
)
from vic_toolbox.control import (
    CartesianLaw,
    Posture,
    Reference,
    feedback_wrench,
    feedforward_wrench,
    simulate,
)
from vic_toolbox.errors import InputError
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.models import RobotModel, SingularityWarning, available_robots, load_robot
from vic_toolbox.spatial import pose_from, rotation_exp

COUNT = 20


class Case:
    """States, references, gains and pushes of one arm, and what the arm does under a torque."""

    def __init__(self, model: RobotModel, *, speed: float = 1.0) -> None:
        self.model = model
        self.q, self.v = random_states(self.model, COUNT, speed=speed)
        generator = np.random.default_rng(1)
        self.reference = random_reference(generator, self.model.pose(self.q))
        self.gains = random_gains(generator, COUNT)
        self.push = generator.normal(size=(COUNT, 6)) * [10.0, 10.0, 10.0, 1.0, 1.0, 1.0]
        self.space = self.model.operational_space(self.q, self.v)
        self.error, self.rate = CartesianLaw(model=self.model).error(self.q, self.v, reference=self.reference)

    def acceleration(self, torque: np.ndarray, push: np.ndarray | None = None) -> np.ndarray:
        """ẍ of every sample, (COUNT, 6)."""
        joint = self.model.acceleration(self.q, self.v, torque, external_wrench=push)
        states = zip(self.q, self.v, joint, strict=True)
        return np.array([task_acceleration(self.model, *state) for state in states])

    def spring_and_damper(self) -> np.ndarray:
        """B ė + K e, (COUNT, 6)."""
        return np.matvec(self.gains.damping, self.rate) + np.matvec(self.gains.stiffness, self.error)


@pytest.fixture(scope="module", params=ARMS)
def case(request: pytest.FixtureRequest) -> Case:
    return Case(arm(request.param))


def assert_closed_loop(case: Case) -> None:
    """M(x) ë + B ė + K e = −F_ext, with and without a push."""
    command = CartesianLaw(model=case.model).impedance(
        case.q, case.v, reference=case.reference, gains=case.gains
    )
    for push in (None, case.push):
        second = case.acceleration(command.torque, push) - case.reference.acceleration
        residual = np.matvec(case.space.mass, second) + case.spring_and_damper()
        np.testing.assert_allclose(residual, 0.0 if push is None else -push, atol=1e-8)


def test_closed_loop_is_the_arms_own_mass_with_spring_and_damper(case: Case) -> None:
    assert_closed_loop(case)


@pytest.mark.parametrize("name", sorted(set(available_robots()) - set(ARMS)))
def test_law_runs_unchanged_on_every_arm_of_the_catalogue(name: str) -> None:
    model = load_robot(name)
    if model.nv < 6:
        pytest.skip("fewer than six joints cannot realise a six-dimensional impedance")
    assert_closed_loop(Case(model))


def test_chosen_inertia_replaces_the_arms_own(case: Case) -> None:
    inertia = np.diag([5.0, 6.0, 7.0, 0.3, 0.2, 0.1])
    command = CartesianLaw(model=case.model, inertia=inertia).impedance(
        case.q, case.v, reference=case.reference, gains=case.gains, external_wrench=case.push
    )
    second = case.acceleration(command.torque, case.push) - case.reference.acceleration
    np.testing.assert_allclose(second @ inertia + case.spring_and_damper(), -case.push, atol=1e-8)


def test_reference_coriolis_leaves_the_coriolis_force_of_the_error(case: Case) -> None:
    law = CartesianLaw(model=case.model, coriolis="reference")
    command = law.impedance(case.q, case.v, reference=case.reference, gains=case.gains)
    second = case.acceleration(command.torque) - case.reference.acceleration
    inverse = case.space.jacobian_inverse
    # C(x,ẋ) in another order of operations: what C(x,ẋ) ẋ is for the joint speed J̄ ẋ, direction by direction.
    matrix = (
        case.space.mass
        @ (
            case.model.jacobian(case.q)
            @ np.linalg.solve(case.model.mass_matrix(case.q), case.model.coriolis_matrix(case.q, case.v))
            - case.space.jacobian_dot
        )
        @ inverse
    )
    residual = np.matvec(case.space.mass, second) + np.matvec(matrix, case.rate) + case.spring_and_damper()
    np.testing.assert_allclose(residual, 0.0, atol=1e-8)


def test_mass_rate_minus_twice_coriolis_is_skew(case: Case) -> None:
    law = CartesianLaw(model=case.model, coriolis="reference")
    step = 1e-6
    ahead, behind = (
        case.model.operational_space(case.q + s * step * case.v, case.v).mass for s in (1.0, -1.0)
    )
    skew = (ahead - behind) / (2 * step) - 2 * law._task_coriolis(case.q, case.v, case.space)
    symmetric = skew + np.swapaxes(skew, -1, -2)
    scale = np.abs(skew).max(axis=(1, 2), keepdims=True)
    assert (np.abs(symmetric) / scale).max() < 1e-5


def test_force_law_accelerates_by_the_wrench_alone(case: Case) -> None:
    command = CartesianLaw(model=case.model).force(case.q, case.v, wrench=case.push)
    second = case.acceleration(command.torque)
    np.testing.assert_allclose(np.matvec(case.space.mass, second), case.push, atol=1e-8)
    np.testing.assert_array_equal(command.feedback, case.push)


def test_impedance_is_the_force_law_of_its_own_feedback(case: Case) -> None:
    law = CartesianLaw(model=case.model)
    still = Reference(case.reference.pose)
    command = law.impedance(case.q, case.v, reference=still, gains=case.gains)
    error, rate = law.error(case.q, case.v, reference=still)
    wrench = feedback_wrench(error, rate, gains=case.gains)
    np.testing.assert_array_equal(law.force(case.q, case.v, wrench=wrench).torque, command.torque)


def test_torque_of_six_joints_is_jacobian_transpose_times_wrench() -> None:
    case = Case(arm("fanuc"))
    command = CartesianLaw(model=case.model).impedance(
        case.q, case.v, reference=case.reference, gains=case.gains
    )
    wrench = command.feedforward + command.feedback
    np.testing.assert_allclose(command.torque, np.vecmat(wrench, case.space.jacobian), rtol=0, atol=1e-9)


def test_without_the_jacobian_rate_a_fast_arm_misses_its_impedance() -> None:
    """To compensate the joint-space bias only is a common shortcut; the term it drops is tens of newtons."""
    case = Case(arm("fanuc"), speed=2.0)
    exact = CartesianLaw(model=case.model).impedance(
        case.q, case.v, reference=case.reference, gains=case.gains
    )
    jacobian_rate = np.matvec(case.space.mass, np.matvec(case.space.jacobian_dot, case.v))
    shortcut = exact.torque + np.vecmat(jacobian_rate, case.space.jacobian)
    second = case.acceleration(shortcut) - case.reference.acceleration
    residual = np.matvec(case.space.mass, second) + case.spring_and_damper()
    np.testing.assert_allclose(residual, jacobian_rate, atol=1e-8)
    assert np.median(np.linalg.norm(residual[:, :3], axis=-1)) > 30.0


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("moving", [False, True], ids=["still", "moving"])
def test_energy_only_leaves_through_the_damper_and_the_environment(name: str, moving: bool) -> None:
    """Passivity: along a motion ``V(T) − V(0) = −∫ ėᵀ B ė + ėᵀ F_ext dt`` with V = ½ ėᵀM(x)ė + ½ eᵀK e."""
    model = arm(name)
    gains = ImpedanceGains.diagonal([120.0, 60.0, 180.0, 4.0, 4.0, 4.0], [60.0, 40.0, 70.0, 3.0, 2.0, 4.0])
    posture = Posture(model.home) if model.nv > 6 else None
    law = CartesianLaw(model=model, coriolis="reference", posture=posture)
    start = model.pose(model.home)
    push = np.array([4.0, -3.0, 2.0, 0.2, -0.1, 0.1])

    def reference(t: float) -> Reference:
        offset = np.array([0.10, -0.05, -0.08])
        turn = np.array([0.3, -0.2, 0.1])
        if not moving:
            return Reference(pose_from(start[:3, 3] + offset, rotation_exp(turn) @ start[:3, :3]))
        phase, rate = np.sin(5.0 * t), 5.0 * np.cos(5.0 * t)
        return Reference(
            pose_from(start[:3, 3] + offset * phase, rotation_exp(turn * phase) @ start[:3, :3]),
            twist=np.concatenate([offset, turn]) * rate,
            acceleration=-25.0 * np.concatenate([offset, turn]) * phase,
        )

    motion = simulate(
        model,
        lambda t, q, v: law.impedance(q, v, reference=reference(t), gains=gains).torque,
        q=model.home,
        duration=0.3,
        timestep=2e-3,
        external_wrench=lambda t, q, v: push,
    )
    along = [reference(t) for t in motion.time]
    poses, twists = (np.array([getattr(r, name) for r in along]) for name in ("pose", "twist"))
    error, rate = motion.error(Reference(poses, twist=twists))
    mass = model.operational_space(motion.q, motion.v).mass
    stored = 0.5 * np.vecdot(rate, np.matvec(mass, rate)) + 0.5 * np.vecdot(
        error, np.matvec(gains.stiffness, error)
    )
    leaving = simpson(np.vecdot(rate, np.matvec(gains.damping, rate)) + rate @ push, x=motion.time)
    assert abs(leaving) > 0.1
    assert stored[-1] - stored[0] == pytest.approx(-leaving, abs=1e-6)


def test_exact_law_exchanges_energy_with_the_changing_mass() -> None:
    """Why the variant exists: with C ẋ cancelled, ``V̇ = −ėᵀBė + ½ ėᵀṀ(x)ė``, which can be positive."""
    case = Case(arm("fanuc"), speed=2.0)
    law = CartesianLaw(model=case.model, coriolis="reference")
    matrix = law._task_coriolis(case.q, case.v, case.space)
    power = np.einsum("ni,nij,nj->n", case.rate, matrix, case.rate)  # ½ ėᵀ Ṁ ė = ėᵀ C ė
    assert power.max() > 1.0


def test_a_batch_is_its_samples(case: Case) -> None:
    posture = Posture(case.model.home)
    law = CartesianLaw(model=case.model, coriolis="reference", posture=posture)
    batch = law.impedance(case.q, case.v, reference=case.reference, gains=case.gains)
    for i in range(3):
        reference = Reference(
            case.reference.pose[i],
            twist=case.reference.twist[i],
            acceleration=case.reference.acceleration[i],
        )
        gains = ImpedanceGains(case.gains.stiffness[i], case.gains.damping[i])
        one = law.impedance(case.q[i], case.v[i], reference=reference, gains=gains)
        for name in ("torque", "feedforward", "feedback"):
            np.testing.assert_allclose(getattr(batch, name)[i], getattr(one, name), rtol=1e-10, atol=1e-10)


def test_one_reference_and_one_pair_of_gains_serve_a_batch() -> None:
    case = Case(arm("fanuc"))
    law = CartesianLaw(model=case.model)
    reference = Reference(case.model.pose(case.model.home))
    gains = ImpedanceGains.diagonal(np.full(6, 50.0), np.full(6, 10.0))
    command = law.impedance(case.q, case.v, reference=reference, gains=gains)
    assert command.torque.shape == (COUNT, 6)
    assert command.feedback.shape == command.feedforward.shape == (COUNT, 6)


def test_at_rest_on_the_reference_the_law_only_carries_the_arm(case: Case) -> None:
    still = np.zeros(case.model.nv)
    command = CartesianLaw(model=case.model).impedance(
        case.q[0],
        still,
        reference=Reference(case.model.pose(case.q[0])),
        gains=ImpedanceGains.diagonal(np.full(6, 100.0), np.full(6, 10.0)),
    )
    np.testing.assert_allclose(command.torque, case.model.gravity(case.q[0]), atol=1e-9)


def test_a_singular_posture_gives_a_finite_torque_and_a_warning() -> None:
    model = arm("ur5")
    stretched = np.zeros(6)
    law = CartesianLaw(model=model)
    reference = Reference(model.pose(model.home))
    gains = ImpedanceGains.diagonal(np.full(6, 50.0), np.full(6, 10.0))
    with pytest.warns(SingularityWarning):
        command = law.impedance(stretched, np.ones(6), reference=reference, gains=gains)
    assert np.abs(command.torque).max() < 1e3


def test_another_frame_is_controlled_on_request() -> None:
    case = Case(arm("fanuc"))
    law = CartesianLaw(model=case.model, frame="tool0")
    error, _ = law.error(case.q, case.v, reference=Reference(case.model.pose(case.q, frame="tool0")))
    np.testing.assert_allclose(error, 0.0, atol=1e-12)


def test_feedforward_alone_follows_the_wanted_acceleration(case: Case) -> None:
    wrench = feedforward_wrench(case.space, case.reference.acceleration)
    inverse = case.space.jacobian_inverse
    joint = case.model.bias(case.q, case.v)
    nullspace = joint - np.vecmat(np.vecmat(joint, inverse), case.space.jacobian)
    second = case.acceleration(np.vecmat(wrench, case.space.jacobian) + nullspace)
    np.testing.assert_allclose(second, case.reference.acceleration, atol=1e-8)


def test_bad_input_is_refused_with_a_way_out() -> None:
    model = arm("fanuc")
    still = np.zeros(6)
    reference = Reference(model.pose(model.home))
    gains = ImpedanceGains.diagonal(np.full(6, 50.0), np.full(6, 10.0))
    law = CartesianLaw(model=model)
    shaped = CartesianLaw(model=model, inertia=np.eye(6))

    with pytest.raises(InputError, match="shape"):
        law.impedance(np.zeros(5), np.zeros(5), reference=reference, gains=gains)
    with pytest.raises(InputError, match="finite"):
        law.impedance(np.full(6, np.nan), still, reference=reference, gains=gains)
    with pytest.raises(InputError, match="leave it out"):
        law.impedance(model.home, still, reference=reference, gains=gains, external_wrench=np.zeros(6))
    with pytest.raises(InputError, match="zeros in free motion"):
        shaped.impedance(model.home, still, reference=reference, gains=gains)
    with pytest.raises(InputError, match="external_wrench"):
        shaped.force(model.home, still, wrench=still, external_wrench=np.full(6, np.inf))
    with pytest.raises(InputError, match="wrench has shape"):
        law.force(model.home, still, wrench=np.zeros(3))
    with pytest.raises(InputError, match="not positive definite"):
        CartesianLaw(model=model, inertia=np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]))
    with pytest.raises(InputError, match="not both"):
        CartesianLaw(model=model, inertia=np.eye(6), coriolis="reference")
    with pytest.raises(InputError, match="exact, reference"):
        CartesianLaw(model=model, coriolis="none")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="pass 6, one for each joint"):
        CartesianLaw(model=model, posture=Posture(np.zeros(7)))
    with pytest.raises(InputError, match="reference pose"):
        Reference(np.eye(3))
    with pytest.raises(InputError, match="reference twist"):
        Reference(np.eye(4), twist=np.zeros(3))
