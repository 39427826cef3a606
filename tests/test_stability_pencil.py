"""The algebra under the certificates: definiteness, intervals of α, slopes, and what lies between samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability.arguments import matrices, positive_matrices
from vic_toolbox.stability.schedules import pencil
from vic_toolbox.stability.schedules.between_samples import Coefficient, failing
from vic_toolbox.stability.schedules.definite import (
    diagonals,
    least_ratio,
    pack,
    positive_definite,
    relative_slack,
    unpack,
)
from vic_toolbox.stability.schedules.pencil import largest, least
from vic_toolbox.stability.schedules.schedule import Schedule, slopes


def symmetric(rng: np.random.Generator, n: int, d: int) -> Array:
    x = rng.normal(size=(n, d, d))
    return x + np.swapaxes(x, 1, 2)


def definite(rng: np.random.Generator, n: int, d: int) -> Array:
    x = rng.normal(size=(n, d, d))
    return x @ np.swapaxes(x, 1, 2) + 0.1 * np.eye(d)


@given(seed=st.integers(0, 10**6), d=st.integers(1, 6), shift=st.floats(-3, 6))
def test_elimination_agrees_with_eigenvalues(seed: int, d: int, shift: float):
    x = symmetric(np.random.default_rng(seed), 50, d) + shift * np.eye(d)
    smallest = np.linalg.eigvalsh(x)[:, 0]
    clear = np.abs(smallest) > 1e-9
    np.testing.assert_array_equal(positive_definite(pack(x))[clear], smallest[clear] > 0)
    np.testing.assert_array_equal(unpack(pack(x)), x)


def test_coupling_is_seen_anywhere():
    rows = np.random.default_rng(0).normal(size=(3, 5000))
    stack = rows.T[:, :, None] * np.eye(3)
    np.testing.assert_array_equal(diagonals(stack), rows)
    for i, j in ((0, 1), (2, 0), (1, 2), (2, 1)):
        x = stack.copy()
        x[4999, i, j] = 1e-300
        assert diagonals(x) is None
        assert diagonals(x[4999]) is None
        assert diagonals(x[4998]) is not None


@given(seed=st.integers(0, 10**6), n=st.integers(1, 3000), d=st.integers(1, 4))
def test_the_interval_of_alpha_ends_at_generalised_eigenvalues(seed: int, n: int, d: int):
    """With B ≻ 0 the least α is max λ_max(−A, B), found to rounding without all eigenvalues."""
    rng = np.random.default_rng(seed)
    a, b = symmetric(rng, n, d), definite(rng, n, d)
    pa, pb = pack(a), pack(b)
    expected = max(eigh(-x, y, eigvals_only=True)[-1] for x, y in zip(a, b, strict=True))
    found = least(lambda s: (pa[:, s], pb[:, s]), n, start=-1e6)
    assert found.value == pytest.approx(expected, rel=1e-8)
    v = found.direction
    assert v is not None
    assert v @ (a[found.index] + found.value * b[found.index]) @ v == pytest.approx(
        0, abs=1e-6 * np.abs(a).max()
    )
    upper = largest(lambda s: (pa[:, s], -pb[:, s]), n, start=1e6)
    assert upper.value == pytest.approx(-expected, rel=1e-8)


def test_the_search_ends_where_elimination_and_eigenvalues_disagree(monkeypatch: pytest.MonkeyPatch):
    """Nearly singular matrices of many samples: one test sees a violation that is rounding to the other."""
    monkeypatch.setattr(pencil, "positive_definite", lambda packed: np.zeros(packed.shape[1], dtype=bool))
    rows = pack(np.tile(np.eye(2), (1000, 1, 1)))
    assert least(lambda samples: (rows[:, samples], rows[:, samples]), 1000, start=0.5).value == 0.5


def test_no_alpha_is_found_where_there_is_none():
    a, b = pack(np.array([[[1.0, 0], [0, -1]]])), pack(np.array([[[-1.0, 0], [0, 0.5]]]))
    assert least(lambda s: (a[:, s], b[:, s]), 1).value == np.inf  # needs α ≥ 2 and α ≤ 1
    one, two = np.array([[1.0, -1]]), np.array([[-1.0, 0.5]])
    assert least(lambda s: (one[:, s], two[:, s]), 2, diagonal=True).value == 2
    assert largest(lambda s: (one[:, s], two[:, s]), 2, start=3.0, diagonal=True).value == 1


@given(seed=st.integers(0, 10**6), n=st.integers(2, 40))
def test_slopes_are_exact_for_polynomials(seed: int, n: int):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, n))
    t /= t[-1]
    p = np.polynomial.Polynomial(rng.normal(size=min(n, 5)))
    np.testing.assert_allclose(slopes(t, p(t)[None])[0], p.deriv()(t), rtol=1e-7, atol=1e-6)


def test_slopes_of_even_samples_and_across_chunks():
    t = np.linspace(0, 20, 9001)
    values = np.stack([np.sin(t), np.cos(3 * t)])
    expected = np.stack([np.cos(t), -3 * np.sin(3 * t)])
    np.testing.assert_allclose(slopes(t, values), expected, atol=2e-8)
    uneven = t + 2e-4 * np.sin(50 * t)
    np.testing.assert_allclose(slopes(uneven, np.sin(uneven)[None])[0], np.cos(uneven), atol=2e-8)


def test_the_cubics_join_and_their_bernstein_form_is_theirs():
    t = np.linspace(0, 2, 30)
    schedule = Schedule.of(t, np.stack([np.exp(t), t**3]), diagonal=True)
    fine = np.linspace(0, 2, 500)
    value, slope = schedule.at(fine)
    np.testing.assert_allclose(value, np.stack([np.exp(fine), fine**3]), atol=1e-6)
    np.testing.assert_allclose(slope, np.stack([np.exp(fine), 3 * fine**2]), atol=1e-4)
    index = np.array([3, 7])
    whole, part = schedule.cubics(index), schedule.cubics(index, np.array([0.25, 0.5]), np.array([0.5, 1.0]))
    start, end = t[3] + 0.25 * (t[4] - t[3]), t[3] + 0.5 * (t[4] - t[3])
    for found, at in ((part.values[0][:, 0], start), (part.values[3][:, 0], end)):
        np.testing.assert_allclose(found, schedule.at(np.array([at]))[0][:, 0], rtol=1e-12)
    np.testing.assert_allclose(part.slopes[3][:, 1], whole.slopes[3][:, 1], rtol=1e-9)
    np.testing.assert_allclose(part.slopes[0][:, 0], schedule.at(np.array([start]))[1][:, 0], rtol=1e-9)


@given(seed=st.integers(0, 10**6), n=st.integers(5, 60), even=st.booleans())
def test_bounds_hold_for_all_bernstein_coefficients(seed: int, n: int, even: bool):
    rng = np.random.default_rng(seed)
    t = np.cumsum(np.full(n, 0.1) if even else rng.uniform(0.01, 1, n))
    schedule = Schedule.of(t, rng.normal(size=(3, n)), diagonal=True)
    start = int(rng.integers(0, n - 2))
    index = slice(start, int(rng.integers(start + 1, n)))
    lowest, steepest = schedule.bounds(index)
    found = schedule.cubics(index)
    for value, slope in zip(found.values, found.slopes, strict=True):
        assert (value >= (lowest - 1e-9 * np.abs(lowest))[:, None]).all()
        assert (np.abs(slope) <= (steepest * (1 + 1e-9))[:, None]).all()


@pytest.mark.parametrize("rate", [1, 7, 40])
def test_jumps_of_held_gains_are_seen_and_smooth_gains_have_none(rate: int):
    t = np.linspace(0, 10, 4001)
    smooth = 500 + 200 * np.sin(t) + 50 * np.sin(7 * t)
    assert not len(Schedule.of(t, smooth[None], diagonal=True).jumps)
    held = np.repeat(smooth[::rate], rate)[: len(t)]
    jumps = Schedule.of(t, held[None], diagonal=True).jumps
    expected = np.flatnonzero(np.abs(np.diff(held)) > 2.0)
    assert set(expected if rate > 2 else []) <= set(jumps)
    one_step = np.where(t < 3, 100.0, 500.0)
    np.testing.assert_array_equal(Schedule.of(t, one_step[None], diagonal=True).jumps, [1199])


def test_what_happens_between_samples_is_seen():
    """A cubic that is positive at both ends and dips below zero between them."""
    t = np.array([0.0, 1.0])
    dip = Schedule(t, np.array([[1.0, 1.0]]), diagonal=True)
    dip.__dict__["slopes"] = np.array([[-6.0, 6.0]])
    left = failing(
        lambda i, low, high: [Coefficient((x,)) for x in dip.cubics(i, low, high).values], 1, diagonal=True
    )
    assert len(left.index)
    assert dip.at(left.instants(t))[0].min() < 0
    shallow = Schedule(t, np.array([[1.0, 1.0]]), diagonal=True)
    shallow.__dict__["slopes"] = np.array([[-3.9, 3.9]])  # least value 0.025: only halving shows it
    found = failing(
        lambda i, low, high: [Coefficient((x,)) for x in shallow.cubics(i, low, high).values],
        1,
        diagonal=True,
    )
    assert not len(found.index)


def test_least_ratio_and_slack():
    rng = np.random.default_rng(0)
    a, b = symmetric(rng, 20, 3), definite(rng, 20, 3)
    expected = [eigh(x, y, eigvals_only=True)[0] for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(least_ratio(a, b), expected, rtol=1e-9)
    size = np.diag([1e-3, 1.0, 1e3])
    assert relative_slack(size @ a @ size, size @ b @ size) == pytest.approx(relative_slack(a, b), rel=1e-9)
    assert relative_slack(b, -b) == 0


def test_large_arrays_are_checked_like_small_ones():
    good = np.tile(np.eye(3), (10_000, 1, 1))
    assert matrices("K", good) is good
    for index, bad, text in (
        (9000, [[0, 1, 0], [0, 0, 0], [0, 0, 0]], "not symmetric"),
        (9001, [[0, 2, 0], [2, 0, 0], [0, 0, 0]], "eigenvalue -1"),
        (9002, [[-2, 0, 0], [0, 0, 0], [0, 0, 0]], "eigenvalue -1"),
    ):
        x = good.copy()
        x[index] += bad
        with pytest.raises(InputError, match=rf"K\[{index}\].*{text}"):
            positive_matrices("K", x)
    positive_matrices("K", np.ones((5, 2, 2)), definite=False)
    with pytest.raises(InputError, match="positive definite"):
        positive_matrices("K", np.zeros((5, 2, 2)))
