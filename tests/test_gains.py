"""Gains: always positive definite, written and read back exactly, and damped as designed."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vic_toolbox import spatial
from vic_toolbox.errors import Array, InputError
from vic_toolbox.gains import (
    AXES,
    PARAMETRISATIONS,
    CholeskyStiffness,
    DampingFactor,
    Diagonal,
    DiagonalStiffness,
    ImpedanceGains,
    Parametrisation,
    double_diagonalisation,
    factor_damping,
    matrix_square_root,
    spd_matrix,
)

SOFT = (60.0, 60.0, 60.0, 1.0, 1.0, 1.0)
STIFF = (200.0, 200.0, 200.0, 6.0, 6.0, 6.0)
# The wide range of a part to be fitted: five decades of stiffness between the axes.
WIDE_LOW = (1.0, 1.0, 450.0, 0.01, 0.01, 0.01)
WIDE_HIGH = (3000.0, 3000.0, 2700.0, 12.0, 12.0, 12.0)

COUPLED_MASS = np.diag([6.0, 5.0, 8.0, 0.09, 0.05, 0.07])
COUPLED_MASS[0, 4] = COUPLED_MASS[4, 0] = 0.2
COUPLED_MASS[1, 3] = COUPLED_MASS[3, 1] = -0.15
MASS_ROWS = tuple(tuple(row) for row in COUPLED_MASS.tolist())

PARAMETRISED: dict[str, Parametrisation] = {
    "diagonal-stiffness": DiagonalStiffness(
        stiffness_low=WIDE_LOW, stiffness_high=WIDE_HIGH, damping=(60, 60, 900, 1.8, 1.8, 1.8)
    ),
    "diagonal": Diagonal(stiffness_low=SOFT, stiffness_high=STIFF, damping_low=SOFT, damping_high=STIFF),
    "damping-factor": DampingFactor(stiffness_low=SOFT, stiffness_high=STIFF, factor_low=9, factor_high=12),
    "damping-factor, rotation fixed": DampingFactor(
        stiffness_low=SOFT, stiffness_high=STIFF, factor_low=9, factor_high=12, rotational_damping=20.8
    ),
    "cholesky-stiffness, factor": CholeskyStiffness(
        stiffness_low=WIDE_LOW, stiffness_high=WIDE_HIGH, damping_factor=10
    ),
    "cholesky-stiffness, mass": CholeskyStiffness(
        stiffness_low=SOFT, stiffness_high=STIFF, mass=MASS_ROWS, damping_ratio=0.7
    ),
}
SIZES = {"diagonal-stiffness": 6, "diagonal": 12, "damping-factor": 7, "cholesky-stiffness": 21}

every = pytest.mark.parametrize("name", PARAMETRISED)


def actions(size: int) -> st.SearchStrategy[Array]:
    """One action or a small batch, corners included."""
    entries = st.one_of(st.floats(-1, 1), st.sampled_from([-1.0, 1.0]))
    shapes = st.sampled_from([(size,), (1, size), (3, size), (2, 2, size)])
    return arrays(np.float64, shapes, elements=entries)


def spd_matrices(size: int = 6, decades: float = 2.0) -> st.SearchStrategy[Array]:
    """Symmetric positive definite matrices with a condition number of up to 10 ** (2 decades)."""

    def build(numbers: tuple[Array, Array]) -> Array:
        basis, _ = np.linalg.qr(numbers[0] + 3 * np.eye(size))
        matrix = (basis * 10.0 ** numbers[1]) @ basis.T
        return 0.5 * (matrix + matrix.T)

    entries = arrays(np.float64, (size, size), elements=st.floats(-1, 1))
    exponents = arrays(np.float64, size, elements=st.floats(-decades, decades))
    return st.tuples(entries, exponents).map(build)


def damping_ratios(mass: Array, damping: Array, stiffness: Array) -> Array:
    """Damping ratios −Re s / |s| of the eigenvalues s of M ë + B ė + K e = 0."""
    n = len(mass)
    system = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)],
        ]
    )
    eigenvalues = np.linalg.eigvals(system)
    return -eigenvalues.real / np.abs(eigenvalues)


# --- the gains ---------------------------------------------------------------------------------------------


def test_gains_are_read_only_copies() -> None:
    stiffness = np.diag(STIFF)
    gains = ImpedanceGains(stiffness, np.eye(6))
    stiffness[0, 0] = 1e6
    assert gains.stiffness[0, 0] == 200.0
    with pytest.raises(ValueError, match="read-only"):
        gains.stiffness[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        gains.stiffness = stiffness  # pyright: ignore[reportAttributeAccessIssue]


def test_one_damping_serves_a_batch_of_stiffnesses() -> None:
    gains = ImpedanceGains(np.stack([np.diag(SOFT), np.diag(STIFF)]), np.eye(6))
    assert gains.batch_shape == (2,)
    assert gains.damping.shape == (2, 6, 6)


def test_diagonal_gains() -> None:
    gains = ImpedanceGains.diagonal([SOFT, STIFF], np.arange(1, 7))
    np.testing.assert_array_equal(gains.stiffness, [np.diag(SOFT), np.diag(STIFF)])
    np.testing.assert_array_equal(gains.stiffness_diagonal, [SOFT, STIFF])
    np.testing.assert_array_equal(gains.damping_diagonal, [np.arange(1, 7)] * 2)


def test_rounding_in_the_symmetry_is_removed() -> None:
    stiffness = np.diag(STIFF)
    stiffness[0, 1] = 1e-8
    gains = ImpedanceGains(stiffness, np.eye(6))
    np.testing.assert_array_equal(gains.stiffness, gains.stiffness.T)


@given(spd_matrices(), spd_matrices(), arrays(np.float64, 3, elements=st.floats(-1, 1)))
def test_rotated_gains_give_the_rotated_wrench(stiffness: Array, damping: Array, w: Array) -> None:
    rotation = spatial.rotation_exp(w)
    gains, rotated = ImpedanceGains(stiffness, damping), ImpedanceGains(stiffness, damping).rotated(rotation)
    for before, after in ((gains.stiffness, rotated.stiffness), (gains.damping, rotated.damping)):
        error = np.array([1.0, -2.0, 0.5, 0.1, 0.3, -0.2])
        wrench = spatial.rotate(before @ error, rotation)
        np.testing.assert_allclose(after @ spatial.rotate(error, rotation), wrench, atol=1e-11)


@given(spd_matrices(), spd_matrices(), arrays(np.float64, 3, elements=st.floats(-1, 1)))
def test_transported_gains_give_the_transported_wrench(stiffness: Array, damping: Array, r: Array) -> None:
    gains = ImpedanceGains(stiffness, damping)
    moved = gains.transported(r)
    twist = np.array([1.0, -2.0, 0.5, 0.1, 0.3, -0.2])
    for before, after in ((gains.stiffness, moved.stiffness), (gains.damping, moved.damping)):
        wrench = spatial.transport_wrench(before @ twist, r)
        np.testing.assert_allclose(after @ spatial.transport_twist(twist, r), wrench, atol=1e-10)


def test_stiffness_of_a_peg_tip_seen_at_its_centre_of_mass() -> None:
    # Tip 60 mm below: a lateral tip stiffness resists turning about the centre of mass with k ℓ².
    tip = ImpedanceGains.diagonal([3000, 3000, 900, 12, 12, 12], [60, 60, 900, 1.8, 1.8, 1.8])
    com = tip.transported([0, 0, 0.06])
    np.testing.assert_allclose(com.stiffness_diagonal, [3000, 3000, 900, 22.8, 22.8, 12])
    np.testing.assert_allclose(abs(com.stiffness[0, 4]), 180)
    jacobian = spatial.twist_transport_matrix([0, 0, -0.06])
    np.testing.assert_allclose(com.stiffness, jacobian.T @ tip.stiffness @ jacobian, atol=1e-12)


def not_positive() -> Array:
    matrix = np.diag(STIFF)
    matrix[0, 1] = matrix[1, 0] = 201.0  # each diagonal entry is positive, an eigenvalue is -1
    return matrix


def asymmetric() -> Array:
    matrix = np.diag(STIFF)
    matrix[0, 1] = 5.0
    return matrix


@pytest.mark.parametrize(
    ("stiffness", "message"),
    [
        (np.diag([np.nan, *STIFF[1:]]), r"stiffness\[0, 0\] is nan"),
        (np.diag([np.inf, *STIFF[1:]]), r"stiffness\[0, 0\] is inf"),
        (np.ones(6), r"stiffness has shape \(6,\)"),
        (np.eye(5), r"stiffness has shape \(5, 5\)"),
        (np.ones((6, 5)), r"stiffness has shape \(6, 5\)"),
        (not_positive(), "stiffness is not positive definite: its smallest eigenvalue is -1"),
        (np.zeros((6, 6)), "stiffness is not positive definite: its smallest eigenvalue is 0"),
        (-np.eye(6), "stiffness is not positive definite"),
        (np.stack([np.eye(6), -np.eye(6)]), "stiffness is not positive definite"),
        (asymmetric(), "stiffness is not symmetric: it differs from its transpose by 5"),
        ("stiff", "not real numbers"),
        (None, "not real numbers"),
    ],
)
def test_bad_gains_are_refused(stiffness: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ImpedanceGains(stiffness, np.eye(6))
    with pytest.raises(InputError, match=message.replace("stiffness", "damping")):
        ImpedanceGains(np.eye(6), stiffness)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ImpedanceGains.diagonal([-1, 1, 1, 1, 1, 1], np.ones(6)), r"stiffness\[0\] is -1"),
        (lambda: ImpedanceGains.diagonal(np.ones(6), np.zeros(6)), r"damping\[0\] is 0"),
        (lambda: ImpedanceGains.diagonal(np.ones(5), np.ones(6)), r"stiffness has shape \(5,\)"),
        (lambda: ImpedanceGains(np.ones((2, 1, 1)) * np.eye(6), np.ones((3, 1, 1)) * np.eye(6)), "batch"),
        (lambda: ImpedanceGains.diagonal(STIFF, STIFF).rotated(2 * np.eye(3)), "not a rotation"),
        (lambda: ImpedanceGains.diagonal(STIFF, STIFF).transported([0, np.nan, 0]), "offset"),
        (lambda: ImpedanceGains.diagonal([STIFF] * 2, STIFF).transported(np.zeros((3, 3))), "batch"),
    ],
)
def test_bad_arguments_of_gains_are_refused(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


# --- damping design ----------------------------------------------------------------------------------------


@given(spd_matrices())
def test_square_root_squares_to_the_matrix(matrix: Array) -> None:
    root = spd_matrix("root", matrix_square_root(matrix))
    np.testing.assert_allclose(root @ root, matrix, atol=1e-12 * np.abs(matrix).max())


@given(spd_matrices(), st.floats(0.1, 100))
def test_factor_damping_squares_to_the_stiffness(stiffness: Array, factor: float) -> None:
    damping = factor_damping(stiffness, factor) / factor
    np.testing.assert_allclose(damping @ damping, stiffness, atol=1e-12 * np.abs(stiffness).max())


def test_factor_damping_of_a_diagonal_is_axis_by_axis() -> None:
    damping = factor_damping([np.diag(SOFT), np.diag(STIFF)], [9, 12])
    expected = [9 * np.sqrt(np.diag(SOFT)), 12 * np.sqrt(np.diag(STIFF))]
    np.testing.assert_allclose(damping, expected, atol=1e-14)


def test_factor_damping_has_the_ratio_that_its_docstring_states() -> None:
    mass, factor = 4.0, 3.0
    damping = factor_damping([[50.0]], factor)
    ratios = damping_ratios(np.array([[mass]]), damping, np.array([[50.0]]))
    np.testing.assert_allclose(ratios, factor / (2 * np.sqrt(mass)))


@given(spd_matrices(), spd_matrices(), st.floats(0.05, 0.95))
def test_double_diagonalisation_gives_every_mode_its_ratio(
    stiffness: Array, mass: Array, ratio: float
) -> None:
    damping = double_diagonalisation(stiffness, mass, damping_ratio=ratio)
    np.testing.assert_allclose(damping_ratios(mass, damping, stiffness), ratio, rtol=1e-5)


@given(spd_matrices(3, 1), spd_matrices(3, 1), st.floats(1.05, 3))
def test_double_diagonalisation_beyond_critical_has_real_pairs(
    stiffness: Array, mass: Array, ratio: float
) -> None:
    # An overdamped mode s² + 2ζωs + ω² has two real roots whose product is ω².
    damping = double_diagonalisation(stiffness, mass, damping_ratio=ratio)
    np.testing.assert_allclose(damping_ratios(mass, damping, stiffness), 1, rtol=1e-9)
    modes = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))
    dampings = np.sort(np.linalg.eigvals(np.linalg.solve(mass, damping)).real)
    np.testing.assert_allclose(dampings, 2 * ratio * modes, rtol=1e-8)


@given(spd_matrices(), spd_matrices(), spd_matrices(decades=0.5))
def test_double_diagonalisation_does_not_depend_on_axes_or_units(
    stiffness: Array, mass: Array, change: Array
) -> None:
    damping = change @ double_diagonalisation(stiffness, mass, damping_ratio=0.7) @ change
    k, m = (0.5 * (x + x.T) for x in (change @ stiffness @ change, change @ mass @ change))
    changed = double_diagonalisation(k, m, damping_ratio=0.7)
    np.testing.assert_allclose(changed, damping, atol=1e-7 * np.abs(damping).max())


def test_each_mode_can_have_its_own_ratio_slowest_first() -> None:
    damping = double_diagonalisation(np.diag([400.0, 100.0]), np.eye(2), damping_ratio=[0.5, 1.0])
    np.testing.assert_allclose(damping, np.diag([2 * 1.0 * 20, 2 * 0.5 * 10]), atol=1e-13)


def test_double_diagonalisation_of_a_batch_is_its_samples() -> None:
    rng = np.random.default_rng(3)
    stiffness = rng.normal(size=(2, 4, 6, 9))
    stiffness = stiffness @ np.swapaxes(stiffness, -1, -2)
    mass = np.stack([np.eye(6), COUPLED_MASS])[:, None]
    batch = double_diagonalisation(stiffness, mass, damping_ratio=0.8)
    for i, j in np.ndindex(2, 4):
        one = double_diagonalisation(stiffness[i, j], mass[i, 0], damping_ratio=0.8)
        np.testing.assert_allclose(batch[i, j], one, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: factor_damping(np.eye(6), 0), "damping factor is 0"),
        (lambda: factor_damping(np.eye(6), np.nan), "damping factor is nan"),
        (lambda: factor_damping(-np.eye(6), 1), "not positive definite"),
        (lambda: factor_damping(np.ones((2, 1, 1)) * np.eye(6), [1, 2, 3]), "batch shapes"),
        (lambda: matrix_square_root(np.ones((2, 3))), "square"),
        (lambda: double_diagonalisation(np.eye(6), np.eye(5)), r"mass has shape \(5, 5\)"),
        (lambda: double_diagonalisation(np.eye(6), np.zeros((6, 6))), "mass is not positive definite"),
        (lambda: double_diagonalisation(np.eye(6), np.eye(6), damping_ratio=-0.7), "damping ratio is -0.7"),
        (lambda: double_diagonalisation(np.eye(6), np.eye(6), damping_ratio=[1, 1]), "damping_ratio"),
    ],
)
def test_bad_damping_designs_are_refused(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


# --- parametrisations --------------------------------------------------------------------------------------


def test_every_registered_parametrisation_is_tested() -> None:
    assert {type(p) for p in PARAMETRISED.values()} == set(PARAMETRISATIONS.values())


@every
def test_size_names_and_bounds_agree(name: str) -> None:
    p = PARAMETRISED[name]
    assert p.size == SIZES[name.split(",")[0]] == len(set(p.names))
    assert p.names[:6] == tuple(f"k_{axis}" for axis in AXES)
    for bound in (p.low, p.high, p.minimum, p.maximum):
        assert bound.shape == (p.size,)
    np.testing.assert_array_equal(p.action_to_parameters(p.low), p.minimum)
    np.testing.assert_array_equal(p.action_to_parameters(p.high), p.maximum)


@every
@given(data=st.data())
def test_actions_give_gains_in_range_and_both_are_read_back(name: str, data: st.DataObject) -> None:
    p = PARAMETRISED[name]
    action = data.draw(actions(p.size))
    gains = p.to_gains(action)  # ImpedanceGains refuses what is not positive definite
    assert gains.batch_shape == action.shape[:-1]
    assert (gains.stiffness_diagonal >= np.array(p.stiffness_low) * (1 - 1e-12)).all()
    assert (gains.stiffness_diagonal <= np.array(p.stiffness_high) * (1 + 1e-12)).all()
    read = p.to_action(gains)
    np.testing.assert_allclose(read, action, atol=1e-9)
    again = p.to_gains(read)
    np.testing.assert_allclose(again.stiffness, gains.stiffness, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(again.damping, gains.damping, rtol=1e-8, atol=1e-8)


@every
def test_a_batch_of_actions_is_its_samples(name: str) -> None:
    p = PARAMETRISED[name]
    action = np.random.default_rng(1).uniform(-1, 1, (4, p.size))
    batch = p.to_gains(action)
    for i in range(4):
        np.testing.assert_allclose(batch.stiffness[i], p.to_gains(action[i]).stiffness, atol=1e-11)
        np.testing.assert_allclose(batch.damping[i], p.to_gains(action[i]).damping, atol=1e-11)


@every
def test_float32_actions_at_the_bounds_are_accepted(name: str) -> None:
    p = PARAMETRISED[name]
    action = np.ones(p.size, np.float32)
    action[::2] = -1
    np.testing.assert_allclose(p.to_action(p.to_gains(action)), action, atol=1e-9)


@every
@pytest.mark.parametrize("factor", [1000.0, 1e-3])
def test_stiffness_off_by_a_thousand_is_refused(name: str, factor: float) -> None:
    p = PARAMETRISED[name]
    gains = p.to_gains(np.zeros(p.size))
    stiffness = np.array(gains.stiffness)
    stiffness[2, 2] *= factor
    damping = p.damping(stiffness) if isinstance(p, CholeskyStiffness) else gains.damping
    if isinstance(p, DampingFactor):
        damping = np.array(gains.damping)
        damping[2, 2] *= np.sqrt(factor)
    with pytest.raises(InputError, match=r"k_z is .*covers \[.*Check the units"):
        p.to_action(ImpedanceGains(stiffness, damping))


@pytest.mark.parametrize(
    ("index", "value", "unit"),
    [
        (2, 0.5, "N/mm: multiply it by 1000"),
        (3, 0.05, "Nm/deg: multiply it by 57.3"),
        (5, 4000.0, "Nmm/rad: multiply it by 0.001"),
        (6, 0.05, "Ns/mm: multiply it by 1000"),
        (11, 0.02, "Nms/deg: multiply it by 57.3"),
    ],
)
def test_gains_in_another_unit_are_recognised(index: int, value: float, unit: str) -> None:
    p = Diagonal(
        stiffness_low=(60, 60, 60, 1, 1, 1),
        stiffness_high=(200, 200, 200, 6, 6, 6),
        damping_low=(20, 20, 20, 0.5, 0.5, 0.5),
        damping_high=(90, 90, 90, 2, 2, 2),
    )
    parameters = (p.minimum + p.maximum) / 2
    parameters[index] = value
    with pytest.raises(InputError, match=f"{p.names[index]} is {value:g}; .* It looks like {unit}"):
        p.parameters_to_action(parameters)
    parameters[index] = 1e6 * p.maximum[index]
    with pytest.raises(InputError, match=r"covers \[[^]]*\]\. Check the units"):
        p.parameters_to_gains(parameters)


@every
def test_bad_actions_are_refused(name: str) -> None:
    p = PARAMETRISED[name]
    zeros = np.zeros(p.size)
    for bad, message in (
        (zeros[:-1], "action has shape"),
        (np.append(zeros, 0), "action has shape"),
        (np.full(p.size, np.nan), r"action\[0\] is nan"),
        (zeros + 1.01, "clip it"),
        (zeros - 3, "clip it"),
        (zeros + 150, "in SI units, turn them into an action with parameters_to_action"),
        ("stiff", "not real numbers"),
    ):
        with pytest.raises(InputError, match=message):
            p.to_gains(bad)
    with pytest.raises(InputError, match="parameters"):
        p.parameters_to_gains(np.full(p.size, np.nan))
    with pytest.raises(InputError, match="k_x is 1e"):
        p.parameters_to_gains(np.where(np.arange(p.size) == 0, 1e7, p.minimum))


@pytest.mark.parametrize("name", [n for n in PARAMETRISED if not n.startswith("cholesky")])
def test_diagonal_parametrisations_refuse_coupled_gains(name: str) -> None:
    p = PARAMETRISED[name]
    gains = p.to_gains(np.zeros(p.size))
    stiffness = np.array(gains.stiffness)
    stiffness[0, 1] = stiffness[1, 0] = 3.0
    with pytest.raises(InputError, match=r"couples the axes.*CholeskyStiffness"):
        p.to_action(ImpedanceGains(stiffness, gains.damping))


@pytest.mark.parametrize("name", [n for n in PARAMETRISED if n != "diagonal"])
def test_damping_that_cannot_be_written_is_refused(name: str) -> None:
    p = PARAMETRISED[name]
    gains = p.to_gains(np.zeros(p.size))
    damping = np.array(gains.damping)
    damping[4, 4] *= 1.01
    with pytest.raises(InputError, match=r"damping departs .* use Diagonal"):
        p.to_action(ImpedanceGains(gains.stiffness, damping))


@every
def test_configuration_is_comparable_hashable_and_survives_json(name: str) -> None:
    p = PARAMETRISED[name]
    again = type(p)(**json.loads(json.dumps(dataclasses.asdict(p))))
    assert again == p
    assert hash(again) == hash(p)


def test_damping_factor_is_the_law_of_the_paper() -> None:
    p = DampingFactor(stiffness_low=SOFT, stiffness_high=STIFF, factor_low=9, factor_high=12)
    gains = p.parameters_to_gains([*STIFF, 9])
    np.testing.assert_allclose(gains.damping, 9 * np.sqrt(np.diag(STIFF)))
    np.testing.assert_allclose(gains.damping, factor_damping(gains.stiffness, 9), atol=1e-12)


def test_fixed_rotational_damping_leaves_the_factor_to_translation() -> None:
    p = PARAMETRISED["damping-factor, rotation fixed"]
    assert isinstance(p, DampingFactor)
    damping = p.damping([[*SOFT, 9], [*STIFF, 12]])
    np.testing.assert_allclose(damping[:, :3], [[9 * np.sqrt(60)] * 3, [12 * np.sqrt(200)] * 3])
    np.testing.assert_array_equal(damping[:, 3:], 20.8)
    np.testing.assert_array_equal(p.parameters_to_gains([*STIFF, 12]).damping_diagonal, damping[1])


def test_cholesky_without_coupling_is_diagonal() -> None:
    p = PARAMETRISED["cholesky-stiffness, factor"]
    action = np.concatenate([np.linspace(-1, 1, 6), np.zeros(15)])
    stiffness = p.to_gains(action).stiffness
    np.testing.assert_allclose(stiffness, np.diag(p.action_to_parameters(action)[:6]), atol=1e-12)


@given(spd_matrices(decades=0.5))
def test_cholesky_writes_any_stiffness(stiffness: Array) -> None:
    low, high = (0.01, 0.01, 0.01, 0.01, 0.01, 0.01), (100.0, 100.0, 100.0, 100.0, 100.0, 100.0)
    p = CholeskyStiffness(stiffness_low=low, stiffness_high=high, damping_factor=1, coupling_limit=0.99)
    gains = ImpedanceGains(stiffness, p.damping(stiffness))
    np.testing.assert_allclose(p.to_gains(p.to_action(gains)).stiffness, stiffness, atol=1e-10)


def test_cholesky_first_coupling_is_the_correlation() -> None:
    p = CholeskyStiffness(stiffness_low=SOFT, stiffness_high=STIFF, damping_factor=10)
    parameters = np.array([*STIFF, 0.5, *np.zeros(14)])
    stiffness = p.parameters_to_gains(parameters).stiffness
    assert p.names[6] == "z_y_x"
    np.testing.assert_allclose(stiffness[0, 1], 0.5 * np.sqrt(200 * 200))


def test_cholesky_damping_designed_for_an_inertia_has_the_ratio() -> None:
    p = PARAMETRISED["cholesky-stiffness, mass"]
    gains = p.to_gains(np.random.default_rng(2).uniform(-0.8, 0.8, (5, 21)))
    for stiffness, damping in zip(gains.stiffness, gains.damping, strict=True):
        np.testing.assert_allclose(damping_ratios(COUPLED_MASS, damping, stiffness), 0.7, rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (DiagonalStiffness, {"damping": (1, 1, 1, 1, 1, -1)}, r"damping\[5\] is -1"),
        (DiagonalStiffness, {"damping": (1, 1)}, r"damping has shape \(2,\)"),
        (
            CholeskyStiffness,
            {"damping_factor": 10, "stiffness_low": (0, *SOFT[1:])},
            r"stiffness_low\[0\] is 0",
        ),
        (
            CholeskyStiffness,
            {"damping_factor": 10, "stiffness_low": (np.nan, *SOFT[1:])},
            r"stiffness_low\[0\] is nan",
        ),
        (CholeskyStiffness, {"damping_factor": 10, "stiffness_low": STIFF}, "the low end must be smaller"),
        (
            CholeskyStiffness,
            {"damping_factor": 10, "stiffness_high": (1.0,)},
            r"stiffness_high has shape \(1,\)",
        ),
        (Diagonal, {"damping_low": STIFF, "damping_high": SOFT}, "the low end must be smaller"),
        (DampingFactor, {"factor_low": 12, "factor_high": 9}, "the low end must be smaller"),
        (DampingFactor, {"factor_low": -1, "factor_high": 9}, "factor_low is -1"),
        (DampingFactor, {"factor_low": 1, "factor_high": 9, "rotational_damping": 0}, "rotational_damping"),
        (CholeskyStiffness, {}, "both missing"),
        (CholeskyStiffness, {"damping_factor": 10, "mass": MASS_ROWS}, "both set"),
        (CholeskyStiffness, {"damping_factor": 10, "coupling_limit": 1.0}, r"must lie in .*0\.99"),
        (CholeskyStiffness, {"damping_factor": 10, "coupling_limit": 0.0}, "coupling_limit is 0"),
        (CholeskyStiffness, {"damping_factor": -10}, "damping_factor is -10"),
        (CholeskyStiffness, {"mass": np.eye(5)}, r"mass has shape \(5, 5\)"),
        (CholeskyStiffness, {"mass": -np.eye(6)}, "mass is not positive definite"),
        (CholeskyStiffness, {"mass": MASS_ROWS, "damping_ratio": 0}, "damping_ratio is 0"),
    ],
)
def test_bad_configurations_are_refused(
    kind: type[Parametrisation], change: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        kind(**{"stiffness_low": SOFT, "stiffness_high": STIFF, **change})
