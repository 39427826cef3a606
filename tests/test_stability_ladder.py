"""What must hold of every verdict on varying gains: proofs never grow, the ladder holds, maps agree with methods."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability import Certificate, CounterExample, Verdict
from vic_toolbox.stability.schedules.alpha_schedule import alpha_schedule
from vic_toolbox.stability.schedules.floquet import floquet
from vic_toolbox.stability.schedules.kb_map import kb_map
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping

pytest.importorskip("clarabel")


def random_schedule(seed: int, d: int, n: int = 240) -> tuple[Array, Array, Array, Array]:
    """A closed smooth schedule of full gains, from well damped to hardly."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, n)
    basis = np.linalg.qr(rng.normal(size=(d, d)))[0]
    phases = rng.uniform(0, 2 * np.pi, (2, d))
    depth = rng.uniform(0.2, 0.9)
    size = rng.uniform(1, 20) * (
        1 + depth * (0.7 * np.sin(t[:, None] + phases[0]) + 0.3 * np.sin(2 * t[:, None] + phases[1]))
    )
    k = np.einsum("ij,nj,kj->nik", basis, size, basis)
    mass = np.eye(d) + 0.2 * np.ones((d, d))
    damping = np.exp(rng.uniform(-2, 2)) * (np.eye(d) + 0.1 * np.ones((d, d)))
    return t, mass, 0.5 * (k + np.swapaxes(k, 1, 2)), damping * (1 + 0.2 * np.cos(t))[:, None, None]


def storage(t: Array, m: Array, k: Array, d: Array, verdict: Verdict) -> Array:
    """V as matrices (n, 2 d, 2 d) of [e; ė] at the samples, from the certificate."""
    assert isinstance(verdict.witness, Certificate)
    alpha = np.broadcast_to(np.asarray(verdict.witness.values["alpha"], dtype=float), t.shape)
    rate = np.gradient(alpha, t, edge_order=2)[:, None, None]
    a, size = alpha[:, None, None], len(m)
    v = np.zeros((len(t), 2 * size, 2 * size))
    v[:, :size, :size] = k + a * d - rate * m
    v[:, :size, size:] = v[:, size:, :size] = a * m
    v[:, size:, size:] = m
    return v


def trajectories(t: Array, m: Array, k: Array, d: Array, starts: Array) -> Array:
    """States (n, count, 2 d) by the classical Runge-Kutta method on gains interpolated by splines."""
    from scipy.interpolate import CubicSpline

    stiffness, damping = CubicSpline(t, k), CubicSpline(t, d)
    size, inverse = len(m), np.linalg.inv(m)

    def rate(now: float, x: Array) -> Array:
        e, v = x[:, :size], x[:, size:]
        return np.concatenate([v, -(e @ stiffness(now) + v @ damping(now)) @ inverse], axis=1)

    found, x, substeps = [starts], starts, 6
    for begin, end in pairwise(t):
        h = (end - begin) / substeps
        for i in range(substeps):
            now = begin + i * h
            k1 = rate(now, x)
            k2 = rate(now + h / 2, x + h / 2 * k1)
            k3 = rate(now + h / 2, x + h / 2 * k2)
            k4 = rate(now + h, x + h * k3)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        found.append(x)
    return np.stack(found)


@settings(max_examples=12)
@given(seed=st.integers(0, 10**6), d=st.integers(1, 3))
def test_a_proved_schedule_never_grows(seed: int, d: int):
    """V of the certificate falls along 1000 random motions, integrated by a third method."""
    t, m, k, b = random_schedule(seed, d)
    for method in (kronander_billard, alpha_schedule):
        verdict = method(m, k, b, time=t)
        if verdict.status != "proved":
            continue
        starts = np.random.default_rng(seed).normal(size=(1000, 2 * d))
        paths = trajectories(t, m, k, b, starts)
        v = np.einsum("nci,nij,ncj->nc", paths, storage(t, m, k, b, verdict), paths)
        assert (np.diff(v, axis=0) <= 1e-3 * np.abs(v[:-1])).all()
        assert (v[-1] <= v[0] * (1 + 1e-6)).all()


def test_the_schedules_are_of_every_kind():
    """So that what is tested here of proved and of disproved ones is tested at all."""
    found = {method: [] for method in (kronander_billard, alpha_schedule)}
    for seed in range(12):
        t, m, k, b = random_schedule(seed, 1 + seed % 2, 160)
        for method, statuses in found.items():
            statuses.append(method(m, k, b, time=t).status)
    one, two = found.values()
    assert one.count("proved") >= 2
    assert two.count("proved") > one.count("proved")
    assert "inconclusive" in one


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), d=st.integers(1, 2))
def test_the_ladder_holds_and_counter_examples_grow(seed: int, d: int):
    """Constant α ⊆ α(t) ⊆ stable; whatever is disproved grows when it is replayed."""
    t, m, k, b = random_schedule(seed, d, 160)
    one, two = kronander_billard(m, k, b, time=t), alpha_schedule(m, k, b, time=t)
    if one.status == "proved":
        assert two.status == "proved"
    statuses = {one.status, two.status}
    assert not {"proved", "disproved"} <= statuses
    for verdict in (one, two):
        if verdict.status == "disproved":
            assert isinstance(verdict.witness, CounterExample)
            path = verdict.witness.replay()[1]
            assert np.linalg.norm(path[-1]) > np.linalg.norm(path[0])
    if "proved" in statuses:
        from scipy.interpolate import CubicSpline

        stiffness, damping = (
            CubicSpline(t, np.concatenate([x[:-1], x[:1]]), bc_type="periodic") for x in (k, b)
        )
        found = floquet(m, lambda s: stiffness(s), lambda s: damping(s), period=2 * np.pi)
        assert found.values["spectral_radius"] < 1


def test_the_ladder_of_kb2():
    """1.805194 (exact) < 4.798 (α(t)) < 7.537784 (constant α)."""
    t = np.linspace(0, 2 * np.pi, 400)
    gains = 12 + 10 * np.sin(t)
    exact = smallest_damping(floquet, 10, lambda s: 12 + 10 * np.sin(s), period=2 * np.pi, tolerance=1e-2)
    schedule = smallest_damping(alpha_schedule, 10, gains, time=t, tolerance=1e-2)
    constant = smallest_damping(kronander_billard, 10, gains, time=t, tolerance=1e-2)
    assert exact < schedule < constant


def test_smallest_damping_at_its_ends():
    assert smallest_damping(kronander_billard, 1, [3, 2], 0, time=[0, 1]) == 0
    with pytest.raises(InputError, match="not proved"):
        smallest_damping(kronander_billard, 1, [2, 3], 0, time=[0, 1])


def test_the_map_agrees_with_the_methods():
    """Spectral radius and both edges of the map against floquet, kronander_billard and alpha_schedule."""
    m, k, d = 10.0, 12.0, 2.2
    natural = np.sqrt(k / m)
    found = kb_map(
        m, k, d, frequency=natural * np.array([0.3, 0.95, 2.0]), amplitude=[0.2, 0.6, 0.9], schedule=False
    )
    for i, a in enumerate(found.amplitude):
        for j, w in enumerate(found.frequency):
            exact = floquet(m, lambda t, a=a, w=w: k * (1 + a * np.sin(w * t)), d, period=2 * np.pi / w)
            assert found.spectral_radius[i, j] == pytest.approx(exact.values["spectral_radius"], rel=1e-6)
            t = np.linspace(0, 2 * np.pi / w, 401)
            certified = kronander_billard(m, k * (1 + a * np.sin(w * t)), d, time=t)
            assert found.required_damping[i, j] == pytest.approx(
                certified.values["required_damping"], rel=1e-5
            )
            assert found.certified[i, j] == (certified.status == "proved")
    assert not (found.certified & ~found.stable).any()


def test_the_map_is_drawn(tmp_path):
    found = kb_map(10, 12, 2.2, frequency=np.linspace(0.3, 3, 30), amplitude=np.linspace(0, 0.9, 20))
    found.plot().savefig(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert found.schedule_edge is not None
    reach = np.interp(found.schedule_edge[:, 0], found.frequency, found.certified_amplitude)
    assert (found.schedule_edge[:, 1] >= np.minimum(reach, 0.97) - 0.02).all()
    with pytest.raises(InputError, match="amplitude"):
        kb_map(10, 12, 2.2, amplitude=[0.5, 1.0])
    with pytest.raises(InputError, match="frequency"):
        kb_map(10, 12, 2.2, frequency=[1.0])
