"""The integrator conserves energy, converges with its order, and shows the impedance that the law promises."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from tests.arms import ARMS, arm
from vic_toolbox.control import CartesianLaw, Motion, Reference, simulate
from vic_toolbox.errors import InputError, ModelError, SimulationError
from vic_toolbox.gains import ImpedanceGains, double_diagonalisation
from vic_toolbox.models import RobotModel
from vic_toolbox.spatial import pose_from

GAINS = ImpedanceGains.diagonal([500.0] * 3 + [50.0] * 3, [60.0] * 3 + [10.0] * 3)
PUSH = np.array([0.0, 10.0, -5.0, 0.0, 0.0, 0.5])


def limp(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """No torque: the arm falls."""
    return np.zeros_like(q)


def energy(model: RobotModel, motion: Motion) -> np.ndarray:
    """Kinetic (with the rotors) and potential energy along the motion, (T,) [J]."""
    data = model.pinocchio.createData()
    potential = [pin.computePotentialEnergy(model.pinocchio, data, q) for q in motion.q]
    return 0.5 * np.vecdot(motion.v, np.matvec(model.mass_matrix(motion.q), motion.v)) + potential


def holding(model: RobotModel, gains: ImpedanceGains, *, inertia: np.ndarray | None = None, push=PUSH):
    """Controller that keeps the home pose, and what the environment does: it pushes with `push`."""
    law, reference = CartesianLaw(model=model, inertia=inertia), Reference(model.pose(model.home))

    def controller(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        sensor = {} if inertia is None else {"external_wrench": -push}
        return law.impedance(q, v, reference=reference, gains=gains, **sensor).torque

    return {"controller": controller, "external_wrench": lambda t, q, v: -push}, reference


@pytest.mark.parametrize("name", ARMS)
def test_a_falling_arm_conserves_its_energy(name: str) -> None:
    model = arm(name)
    motion = simulate(model, limp, q=model.home, duration=0.3)
    assert np.abs(motion.v[-1]).max() > 0.5
    total = energy(model, motion)
    np.testing.assert_allclose(total, total[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize(("method", "order"), [("runge-kutta", 4), ("semi-implicit", 1)])
def test_the_error_shrinks_with_the_order_of_the_method(method, order: int) -> None:
    model = arm("fanuc")
    environment, _ = holding(model, GAINS)
    ends = [
        simulate(model, q=model.home, duration=0.128, timestep=dt, method=method, **environment).q[-1]
        for dt in (8e-3, 4e-3, 2e-3)
    ]
    coarse, fine = (np.linalg.norm(a - b) for a, b in itertools.pairwise(ends))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("name", ARMS)
def test_a_chosen_inertia_answers_a_push_as_the_textbook_says(name: str) -> None:
    """``M_d ë + B ė + K e = w`` has a closed solution; every arm follows it, along and about an axis."""
    model, inertia = arm(name), np.diag([6.0, 6.0, 6.0, 0.4, 0.4, 0.4])
    for push in (np.array([4.0, -10.0, 6.0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1.0])):
        environment, reference = holding(model, GAINS, inertia=inertia, push=push)
        motion = simulate(model, q=model.home, duration=0.4, timestep=2e-3, **environment)
        error, rate = motion.error(reference)
        inverse = np.linalg.inv(inertia)
        system = np.zeros((13, 13))  # d/dt [e; ė; 1]
        system[:6, 6:12] = np.eye(6)
        system[6:12, :6], system[6:12, 6:12] = -inverse @ GAINS.stiffness, -inverse @ GAINS.damping
        system[6:12, 12] = inverse @ push
        expected = np.array([expm(t * system)[:12, 12] for t in motion.time[::20]])
        np.testing.assert_allclose(np.hstack([error, rate])[::20], expected, atol=1e-6)


def test_an_arm_comes_to_rest_where_the_spring_carries_the_push() -> None:
    model = arm("fanuc")
    mass = model.operational_space(model.home, np.zeros(6)).mass
    gains = ImpedanceGains(GAINS.stiffness, double_diagonalisation(GAINS.stiffness, mass))
    environment, reference = holding(model, gains)
    motion = simulate(model, q=model.home, duration=2.5, timestep=5e-3, **environment)
    error, rate = motion.error(reference)
    np.testing.assert_allclose(GAINS.stiffness @ error[-1], PUSH, atol=0.02)
    np.testing.assert_allclose(rate[-1], 0.0, atol=1e-4)
    np.testing.assert_array_equal(motion.external_wrench, np.tile(-PUSH, (501, 1)))


def test_a_spring_in_the_environment_shares_the_load() -> None:
    """Two springs in series about different points: the arm rests where their forces are equal."""
    model, wall, depth = arm("fanuc"), 1500.0, 0.03
    environment, reference = holding(model, GAINS)
    behind = reference.pose[2, 3] - depth  # the wall pulls the end-effector down to here

    def pull(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([0, 0, wall * (model.pose(q)[2, 3] - behind), 0, 0, 0])

    environment["external_wrench"] = pull
    motion = simulate(model, q=model.home, duration=3.0, timestep=5e-3, **environment)
    error, _ = motion.error(reference)
    assert error[-1, 2] == pytest.approx(-depth * wall / (wall + 500.0), abs=1e-5)


def test_what_is_recorded_belongs_to_the_same_moments() -> None:
    model = arm("fanuc")
    environment, reference = holding(model, GAINS)
    motion = simulate(model, q=model.home, duration=0.1, timestep=4e-3, frame="tool0", **environment)
    np.testing.assert_allclose(motion.time, 4e-3 * np.arange(26))
    assert motion.q.shape == motion.v.shape == motion.torque.shape == (26, 6)
    np.testing.assert_array_equal(motion.q[0], model.home)
    np.testing.assert_array_equal(motion.v[0], 0.0)
    np.testing.assert_array_equal(motion.pose, model.pose(motion.q, frame="tool0"))
    np.testing.assert_array_equal(motion.twist, model.twist(motion.q, motion.v, frame="tool0"))
    for i in (0, 13, 25):
        torque = environment["controller"](motion.time[i], motion.q[i], motion.v[i])
        np.testing.assert_array_equal(motion.torque[i], torque)
    moved = pose_from(reference.pose[:3, 3] + [0.1, 0.0, 0.0], reference.pose[:3, :3])
    shifted, rate = motion.error(Reference(moved, twist=np.ones(6)))
    np.testing.assert_allclose(shifted[:, 0], motion.pose[:, 0, 3] - moved[0, 3], atol=1e-15)
    np.testing.assert_array_equal(rate, motion.twist - 1.0)


@pytest.mark.parametrize("method", ["runge-kutta", "semi-implicit"])
def test_a_batch_is_its_samples_and_one_start_serves_it(method) -> None:
    model = arm("panda")
    softer = ImpedanceGains(0.5 * GAINS.stiffness, GAINS.damping)
    both = ImpedanceGains(
        *(np.stack([getattr(g, k) for g in (GAINS, softer)]) for k in ("stiffness", "damping"))
    )
    settings = {"q": model.home, "v": np.full(7, 0.1), "duration": 0.02, "timestep": 2e-3, "method": method}
    batch = simulate(model, **holding(model, both)[0], **settings)
    assert batch.q.shape == (11, 2, 7)
    assert batch.external_wrench.shape == (11, 2, 6)
    assert batch.pose.shape == (11, 2, 4, 4)
    for i, gains in enumerate((GAINS, softer)):
        one = simulate(model, **holding(model, gains)[0], **settings)
        np.testing.assert_allclose(batch.q[:, i], one.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(batch.torque[:, i], one.torque, rtol=1e-9, atol=1e-9)


def test_a_held_torque_cannot_damp_without_limit() -> None:
    """``timestep · λmax(M(x)⁻¹ B) < 2``: calm below the limit, divergent above it."""
    model = arm("fanuc")
    mass = model.operational_space(model.home, np.zeros(6)).mass
    fastest = np.linalg.eigvals(np.linalg.solve(mass, GAINS.damping)).real.max()
    environment, reference = holding(model, GAINS)
    settings = {"q": model.home, "method": "semi-implicit", **environment}
    calm = simulate(model, duration=2.0, timestep=1.5 / fastest, **settings)
    assert np.linalg.norm(calm.error(reference)[1][-1]) < 0.01
    with pytest.raises(SimulationError, match=r"diverges at .* s: .* Shorten the timestep"):
        simulate(model, duration=10.0, timestep=3.0 / fastest, **settings)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"q": np.zeros(5)}, InputError, "q has shape"),
        ({"q": np.full(6, np.nan)}, InputError, "q.* finite"),
        ({"v": np.zeros((2, 5))}, InputError, "v has shape"),
        ({"q": np.zeros((2, 6)), "v": np.zeros((3, 6))}, InputError, "batch"),
        ({"duration": 0.0}, InputError, "duration"),
        ({"duration": 1e-5}, InputError, "one whole step"),
        ({"timestep": -1e-3}, InputError, "timestep"),
        ({"timestep": np.nan}, InputError, "timestep"),
        ({"method": "leapfrog"}, InputError, "runge-kutta, semi-implicit"),
        ({"frame": "nose"}, ModelError, "tool0"),
        ({"external_wrench": lambda t, q, v: np.zeros(3)}, InputError, "external_wrench has shape"),
        ({"controller": lambda t, q, v: np.zeros(7)}, InputError, "the controller's torque has shape"),
        ({"controller": lambda t, q, v: np.full(6, np.nan)}, InputError, "the controller's torque.* finite"),
        ({"controller": lambda t, q, v: None}, InputError, "the controller's torque"),
    ],
)
def test_bad_input_is_refused_with_a_way_out(change: dict, error: type, message: str) -> None:
    model = arm("fanuc")
    options = {"controller": limp, "q": model.home, "duration": 0.01} | change
    with pytest.raises(error, match=message):
        simulate(model, options.pop("controller"), **options)
