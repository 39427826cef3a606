"""Stable for every change of the gains within a range: one quadratic Lyapunov function for all its vertices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.sparse.csgraph import connected_components
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, finite_array
from vic_toolbox.stability.arguments import impedance
from vic_toolbox.stability.environments.linear_loop import integrated
from vic_toolbox.stability.ranges.destabilising_switching import carried, destabilising_word, repeated
from vic_toolbox.stability.ranges.quadratic import DIGITS, CommonQuadratic, Trouble, best_common_quadratic
from vic_toolbox.stability.ranges.switching import worst_case_switching
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict, status_of

SURE = 1e-9
"""Smallest decay rate that counts, relative to the fastest system."""
SOFTEST = 1e-6
"""Floor of the stiffness that scales the coordinates, relative to the largest."""
AMPLITUDE = 1e-3
KEPT = 2000
"""Instants of a counter-example, at most about."""


class _Group(NamedTuple):
    """Axes that act on each other, their systems in scaled coordinates ``z = T [e; ė]``, and the unit of rate [1/s]."""

    axes: np.ndarray
    systems: Array
    scaling: Array
    unit: float


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def common_lyapunov(mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> Verdict:
    """Is ``M ë + D(t) ė + K(t) e = 0`` stable for every change of the gains within the hull of the vertices?

    One P ≻ 0 with ``Aᵢᵀ P + P Aᵢ ≺ 0`` at every vertex, ``A = [[0, 1], [−M⁻¹K, −M⁻¹D]]``, proves it for gains that
    change arbitrarily fast. Where there is no such P nothing is proved: for one axis with ``k ∈ [k₁, k₂]`` it needs
    ``b > √m (√k₂ − √k₁)``, more than :func:`~vic_toolbox.stability.worst_case_switching` does. Then a switching
    sequence that makes a motion grow is searched for. Axes that no vertex couples are judged on their own, which loses
    nothing.

    Parameters
    ----------
    mass : float, (d, d) or (n, d, d)
        M ≻ 0 [kg, kg m²]. Vertices of the mass are those of ``(M⁻¹K, M⁻¹D)``, and Ṁ and C are left out.
    stiffness, damping : float, (n,), (d, d) or (n, d, d)
        K ⪰ 0 [N/m, Nm/rad] and D ⪰ 0 [Ns/m, Nms/rad] at the n vertices, *paired*: the i-th K stands with the i-th D,
        and what is given once, alone or as a list of one, with all of them.
        :func:`~vic_toolbox.stability.ranges.gain_box` makes the vertices of a box of diagonal gains.

    Returns
    -------
    Verdict
        Margin: decay rate [1/s] that the best P guarantees, ``V(t) ≤ V(0) exp(−2 rate t)``; negative where V may grow.
        Values: ``decay_rate``, ``overshoot`` (largest growth of the scaled state before it decays, √cond P),
        ``group`` (d,): axes with the same number act on each other.

    Raises
    ------
    InputError
        Gains that are asymmetric, indefinite or not finite; sizes or numbers of vertices that differ.
    DependencyError
        cvxpy or Clarabel is missing: ``pip install 'vic-toolbox[lmi]'``.

    References
    ----------
    S. Boyd, L. El Ghaoui, E. Feron, V. Balakrishnan, Linear Matrix Inequalities in System and Control Theory, 1994,
    sec. 5.1.
    """
    masses, springs, dampers = _paired(mass, stiffness, damping)
    count, d = masses.shape[:2]
    groups = _groups(masses, springs, dampers)
    answers = [best_common_quadratic(group.systems) for group in groups]
    trouble = next((a.message for a in answers if isinstance(a, Trouble)), "")
    found = [a for a in answers if isinstance(a, CommonQuadratic)]
    rates = [a.rate * g.unit for a, g in zip(answers, groups, strict=True) if isinstance(a, CommonQuadratic)]
    rate = min(rates) if len(rates) == len(groups) else float("nan")
    values: dict = {"decay_rate": rate, "group": _labels(groups, d)}
    witness: Certificate | CounterExample | None = None
    reason = trouble
    if not trouble and all(one.rate > SURE for one in found):
        values["overshoot"] = float(np.sqrt(max(np.linalg.cond(one.matrix) for one in found)))
        witness = Certificate(
            "Aᵢᵀ P + P Aᵢ ≺ 0 at every vertex, P ≻ 0, by the eigenvalues of each (slack: decay rate, 1/s)",
            {"P": _assembled(groups, found, d)},
            rate,
        )
    else:
        for group, answer in zip(groups, answers, strict=True):
            if isinstance(answer, CommonQuadratic) and answer.rate > SURE:
                continue
            witness = _growing(group, answer, masses, springs, dampers)
            if witness is not None:
                break
        else:
            reason = reason or (
                "no common quadratic Lyapunov function, and no switching was found that makes a motion grow; "
                "such a function is enough for stability, not necessary."
            )
    return Verdict(
        status_of(witness),
        f"M ë + D ė + K e = 0 with gains that change anyhow within the hull of {count} vertices: stable?",
        "common quadratic Lyapunov function by LMI, cvxpy and Clarabel (Boyd et al. 1994, sec. 5.1)",
        margin=rate,
        margin_unit="1/s (guaranteed decay rate)",
        values=values,
        witness=witness,
        assumptions=(
            "linear gains; Ṁ and Coriolis terms left out; gains may jump and change arbitrarily fast",
        ),
        reason="" if isinstance(witness, CounterExample) else reason,
    )


def certified(mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> bool:
    """Whether there is a common quadratic Lyapunov function, and no more: quick enough for a bisection."""
    answers = (
        best_common_quadratic(g.systems, sign_only=True) for g in _groups(*_paired(mass, stiffness, damping))
    )
    return all(isinstance(answer, CommonQuadratic) and answer.rate > SURE for answer in answers)


def _paired(mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> tuple[Array, Array, Array]:
    given = impedance(*(_vertex(x) for x in (mass, stiffness, damping)))
    d = given.mass.shape[-1]
    count = max(len(a) if a.ndim == 3 else 1 for a in given)
    masses, springs, dampers = (np.broadcast_to(a, (count, d, d)) for a in given)
    return masses, springs, dampers


def _vertex(value: ArrayLike) -> ArrayLike:
    """A list of one vertex as that vertex, which then stands with all of the others."""
    array = finite_array("a vertex", value)
    return array[0] if array.ndim in (1, 3) and len(array) == 1 else array


def _groups(masses: Array, springs: Array, dampers: Array) -> list[_Group]:
    d = masses.shape[-1]
    linked = (np.abs(np.concatenate([masses, springs, dampers])) > 0).any(axis=0)
    number, labels = connected_components(linked, directed=False)
    groups = []
    for label in range(number):
        axes = np.flatnonzero(labels == label)
        blocks = (gains[:, axes[:, None], axes] for gains in (masses, springs, dampers))
        groups.append(_scaled(axes, *blocks))
    assert sum(len(group.axes) for group in groups) == d
    return groups


def _labels(groups: list[_Group], d: int) -> np.ndarray:
    labels = np.empty(d, dtype=np.int64)
    for number, group in enumerate(groups):
        labels[group.axes] = number
    return labels


def _scaled(axes: np.ndarray, masses: Array, springs: Array, dampers: Array) -> _Group:
    """Coordinates ``[W Lᵀe; Lᵀė]`` with mean mass L Lᵀ and mean stiffness L W² Lᵀ, time in 1/unit: without units."""
    d = len(axes)
    factor = np.linalg.cholesky(masses.mean(axis=0))
    inverse = np.linalg.inv(factor)
    squares, directions = np.linalg.eigh(inverse @ springs.mean(axis=0) @ inverse.T)
    rates = np.linalg.eigvalsh(inverse @ dampers.mean(axis=0) @ inverse.T)
    largest = squares[-1] if squares[-1] > 0 else max(rates[-1], 1.0) ** 2
    natural = (directions * np.sqrt(np.maximum(squares, SOFTEST * largest))) @ directions.T
    scaling = np.zeros((2 * d, 2 * d))
    scaling[:d, :d], scaling[d:, d:] = natural @ factor.T, factor.T
    systems = np.zeros((len(masses), 2 * d, 2 * d))
    systems[:, :d, d:] = np.eye(d)
    systems[:, d:, :d], systems[:, d:, d:] = (
        -np.linalg.solve(masses, springs),
        -np.linalg.solve(masses, dampers),
    )
    systems = scaling @ systems @ np.linalg.inv(scaling)
    unit = float(np.linalg.norm(systems, ord=2, axis=(-2, -1)).max())
    return _Group(axes, systems / unit, scaling, unit)


def _assembled(groups: list[_Group], found: list[CommonQuadratic], d: int) -> Array:
    """P of [e; ė] over all axes, in their units."""
    whole = np.zeros((2 * d, 2 * d))
    for group, answer in zip(groups, found, strict=True):
        rows = np.concatenate([group.axes, d + group.axes])
        whole[rows[:, None], rows] = group.scaling.T @ answer.matrix @ group.scaling
    return whole


def _growing(
    group: _Group, answer: CommonQuadratic | Trouble, masses: Array, springs: Array, dampers: Array
) -> CounterExample | None:
    """A motion of the group's axes that a switching between the vertices makes grow; the other axes rest."""
    if len(group.axes) == 1:
        axis = int(group.axes[0])
        m, k, b = (array[:, axis, axis] for array in (masses, springs, dampers))
        if np.ptp(m) == 0 and np.ptp(b) == 0 and k.max() > 0:
            return _exact(axis, float(m[0]), k, float(b[0]), masses.shape[-1], springs, dampers)
    matrix = np.eye(2 * len(group.axes)) if isinstance(answer, Trouble) else answer.matrix
    # one search in whatever units the gains were given: what it finds is carried on with all digits
    word = destabilising_word(np.round(group.systems, DIGITS), np.round(matrix, DIGITS))
    if word is None:
        return None
    sequence = repeated(word)
    back = np.linalg.inv(group.scaling)
    first = expm(group.systems * word.step)
    start = word.start * AMPLITUDE / np.linalg.norm((back @ word.start)[: len(group.axes)])
    other = np.stack([integrated(a, word.step) for a in group.systems])
    d = masses.shape[-1]
    rows = np.concatenate([group.axes, d + group.axes])
    every = max(1, len(sequence) // KEPT)
    kept = np.unique(np.append(np.arange(0, len(sequence) + 1, every), len(sequence)))
    time = kept * word.step / group.unit

    def motion(maps: np.ndarray, initial: Array) -> Array:
        states = np.zeros((len(kept), 2 * d))
        states[:, rows] = carried(maps, sequence, group.scaling @ initial[rows])[kept] @ back.T
        return states

    initial = np.zeros(2 * d)
    initial[rows] = back @ start
    state = motion(first, initial)
    vertices = np.append(sequence, sequence[-1])[kept]
    energy = 0.5 * np.einsum("ti,tij,tj->t", state[:, d:], masses[vertices], state[:, d:])
    energy += 0.5 * np.einsum("ti,ij,tj->t", state[:, :d], springs.mean(axis=0), state[:, :d])
    example = CounterExample(
        f"a period of {len(word.sequence)} steps between {len(np.unique(word.sequence))} vertices: "
        f"×{word.growth:.6g} each",
        time,
        state,
        energy,
        gains={"stiffness": springs[vertices], "damping": dampers[vertices], "vertex": vertices},
        again=lambda initial: (time, motion(other, np.asarray(initial))),
    )
    grows = np.linalg.norm(example.replay()[1][-1]) > np.linalg.norm(initial)
    return example if grows and example.growth > 1 else None


def _exact(
    axis: int, m: float, k: Array, b: float, d: int, springs: Array, dampers: Array
) -> CounterExample | None:
    """One axis with one mass and damping: its exact worst case, the other axes at rest."""
    verdict = worst_case_switching(m, (float(k.min()), float(k.max())), b)
    found = verdict.witness
    if not isinstance(found, CounterExample):
        return None
    vertices = np.where(found.gains["stiffness"][:, 0, 0] > k.min(), int(np.argmax(k)), int(np.argmin(k)))

    def whole(state: Array) -> Array:
        states = np.zeros((len(state), 2 * d))
        states[:, [axis, d + axis]] = state
        return states

    def again(initial: Array) -> tuple[Array, Array]:
        time, state = found.replay(np.asarray(initial)[[axis, d + axis]])
        return time, whole(state)

    return CounterExample(
        f"axis {axis}: {found.description}",
        found.time,
        whole(found.state),
        found.energy,
        gains={"stiffness": springs[vertices], "damping": dampers[vertices], "vertex": vertices},
        again=again,
    )
