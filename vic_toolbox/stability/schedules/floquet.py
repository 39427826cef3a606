r"""Periodic gains: exactly stable or not, by the multipliers of one period (Floquet).

The state [e; ė] after a period is ``Φ`` times the state before it. The motion decays iff the spectral radius ρ(Φ) is
below one, and grows along the eigenvector of a multiplier above one. Liouville's formula
``det Φ = exp(−∫ tr(M⁻¹ D) dt)`` is a check that costs nothing.

References
----------
G. Floquet, "Sur les équations différentielles linéaires à coefficients périodiques", Ann. Sci. ENS 12, 1883.
W. Magnus, S. Winkler, "Hill's Equation", Interscience, 1966.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_lyapunov
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, Number, positive
from vic_toolbox.stability.arguments import Source, at, positive_matrices
from vic_toolbox.stability.schedules.free_motion import CHECK, REFERENCE, FreeMotion, IntegrationError
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

METHOD = "Floquet: spectral radius of the transition matrix over one period"
MARGINAL = 1e-8
"""Distance of the spectral radius from one that is never told from it."""
GROWN = 10.0
"""How much the state of a counter-example should grow ..."""
ROUNDS = 60
"""... within this number of periods."""
INSTANTS = 64
"""Of a period at which its transition matrix is kept ..."""
SHOWN = 512
"""... and of a counter-example, at most."""
_PHASES = np.array([0.113, 0.291, 0.457, 0.638, 0.809, 0.967])


@threadpool_limits.wrap(limits=1, user_api="blas")
def floquet(mass: Source, stiffness: Source, damping: Source, *, period: Number) -> Verdict:
    """Is ``M(t) ë + D(t) ė + K(t) e = 0`` stable when M, K and D repeat every `period` seconds.

    Exact but for integration errors, which are measured: every Φ is computed by two integrators.

    Parameters
    ----------
    mass, stiffness, damping : number, array_like (d, d) or callable
        Constants, or functions of t [s] that return one. They may jump. The stiffness may be negative at times.
    period : number
        [s]

    Returns
    -------
    Verdict
        `values`: ``spectral_radius``, ``multipliers`` (2 d,) complex, ``monodromy`` Φ (2 d, 2 d) for [e; ė],
        ``determinant`` of Φ, ``liouville`` (what the determinant must be), ``integration_error``.

        *Proved* by P with ``Φᵀ P Φ ≺ P``, checked with the Φ of another integrator (or, for one undamped axis, by
        ``|tr Φ| < 2``); *disproved* by the motion along the worst eigenvector; *inconclusive* on the border.
        The margin is ``1 − ρ``.

    Raises
    ------
    InputError
        Gains that are not symmetric, not finite, not periodic, a mass or damping that is not positive, a period
        that is not.
    """
    length = positive("period", period)
    _check(mass, stiffness, damping, length)
    return judged(FreeMotion.given(mass, stiffness, damping, stop=length))


@dataclass(frozen=True, eq=False)
class Multipliers:
    """What one period does to the state."""

    path: Array
    """Φ from the start of the period to evenly spaced instants of it, in the coordinates without units."""
    check: Array
    """The same by another integrator."""
    values: Array
    """Multipliers, complex."""
    vectors: Array
    error: float
    """Largest difference of the two Φ."""

    @property
    def scaled(self) -> Array:
        """Φ over the period, in the coordinates without units."""
        return self.path[-1]

    @property
    def radius(self) -> float:
        """Spectral radius."""
        return float(np.abs(self.values).max())

    @property
    def tolerance(self) -> float:
        """Distance from one within which the radius is not told from it."""
        return max(MARGINAL, 10 * self.error)


def multipliers(motion: FreeMotion) -> Multipliers:
    """Integrate one period by two routes."""
    t = np.linspace(motion.start, motion.stop, INSTANTS + 1)
    path = motion.integrated(t, method=REFERENCE, rtol=1e-12)
    check = motion.integrated(t[-1:], method=CHECK, rtol=1e-11)[0]
    values, vectors = np.linalg.eig(path[-1])
    return Multipliers(path, check, values, vectors, float(np.abs(path[-1] - check).max()))


def judged(motion: FreeMotion, *, method: str = METHOD, assumptions: tuple[str, ...] = ()) -> Verdict:
    """The verdict on a motion whose interval is one period."""
    length = motion.stop - motion.start
    question = f"M(t) ë + D(t) ė + K(t) e = 0 with gains that repeat every {length:.6g} s is stable"
    try:
        found = multipliers(motion)
    except IntegrationError as error:
        return Verdict("inconclusive", question, method, assumptions=assumptions, reason=str(error))
    radius = found.radius
    t = np.linspace(motion.start, motion.stop, 2001)
    m, _, d = motion.matrices(t)
    rates = np.trace(np.linalg.solve(m, d), axis1=1, axis2=2)
    with np.errstate(over="ignore"):
        determinant = float(np.linalg.det(found.scaled))
    values = {
        "spectral_radius": radius,
        "multipliers": found.values,
        "monodromy": found.scaled * motion.scale[:, None] / motion.scale,
        "determinant": determinant,
        "liouville": float(np.exp(-np.trapezoid(rates, t))),
        "integration_error": found.error,
        "period": length,
    }
    margin, unit = 1 - radius, "below a spectral radius of one"
    notes = (*assumptions, "the gains repeat for ever")
    witness, reason = None, ""
    if not rates.any() and len(found.values) == 2:
        witness = _undamped(found)
        notes = (*notes, "without damping, stable means bounded: nothing decays")
        if witness is None and radius <= 1 + found.tolerance:
            reason = "the multipliers meet on the unit circle: the border, where rounding decides"
    elif radius < 1 - found.tolerance:
        witness = _decaying(found)
        reason = "" if witness.slack >= 0 else "the integrators do not agree well enough"
    elif radius <= 1 + found.tolerance:
        reason = f"marginal: the spectral radius is one to within {found.tolerance:.1g}"
    if witness is None and radius > 1 + found.tolerance:
        example = growing(motion, found)
        if example is not None:
            return Verdict(
                "disproved", question, method, margin, unit, values, witness=example, assumptions=notes
            )
        reason = f"growth is too slow to be shown within {ROUNDS} periods"
    proved = witness is not None and witness.slack >= 0
    status = "proved" if proved else "inconclusive"
    return Verdict(status, question, method, margin, unit, values, witness, assumptions=notes, reason=reason)


def growing(motion: FreeMotion, found: Multipliers) -> CounterExample | None:
    """The motion along the eigenvector of the worst multiplier, if another integrator sees it grow as well."""
    length, radius = motion.stop - motion.start, found.radius
    start, rounds = _start(motion, found)
    stride = 1
    while rounds * INSTANTS // stride > SHOWN:
        stride *= 2
    within = np.arange(0, INSTANTS, stride)
    t = motion.start + length * np.append(
        np.add.outer(np.arange(rounds), within / INSTANTS).reshape(-1), rounds
    )
    inside = motion.start + length * np.append(np.tile(within / INSTANTS, rounds), 0.0)
    gains = motion.matrices(inside)
    state, now = np.empty((len(t), len(start))), start / motion.scale
    for k in range(rounds):
        state[k * len(within) : (k + 1) * len(within)] = found.path[within] @ now * motion.scale
        now = found.scaled @ now
    state[-1] = now * motion.scale

    def again(initial: Array) -> tuple[Array, Array]:
        return t, motion.motion(initial, t, method=CHECK, rounds=rounds)

    # what the replay comes to: the other integrator's Φ, as often
    ends = np.linalg.matrix_power(found.check, rounds) @ (start / motion.scale) * motion.scale
    replayed = np.stack([start, ends])
    springs = bool((np.linalg.eigvalsh(gains[1])[:, 0] > 0).all())
    energy = motion.energy(inside, state) if springs else motion.size(state)
    sizes = [motion.energy(inside[[0, -1]], x) for x in (state[[0, -1]], replayed)] if springs else []
    sizes += [motion.size(x) for x in (state[[0, -1]], replayed)]
    if not all(after > before for before, after in sizes):
        return None
    quantity = "its energy" if springs else "½ Σ m (ė² + ω² e²), since the stiffness is negative at times,"
    return CounterExample(
        f"this motion grows by {radius:.6g} in every period of {length:.6g} s: in {rounds} periods {quantity} is "
        f"multiplied by {energy[-1] / energy[0]:.3g}",
        time=t,
        state=state,
        energy=energy,
        gains={"stiffness": gains[1], "damping": gains[2]},
        again=again,
    )


def _start(motion: FreeMotion, found: Multipliers) -> tuple[Array, int]:
    """Initial state [e; ė] and number of periods with the best growth: a complex eigenvector turns as it grows."""
    worst = int(np.argmax(np.abs(found.values)))
    multiplier, vector = found.values[worst], found.vectors[:, worst]
    most = int(np.clip(np.ceil(np.log(GROWN) / np.log(found.radius)), 1, ROUNDS))
    rounds = np.arange(1, most + 1)
    phases = (
        np.exp(1j * np.linspace(0, np.pi, 24, endpoint=False)) if abs(multiplier.imag) > 0 else np.ones(1)
    )
    real = np.real(vector / vector[np.argmax(np.abs(vector))] * phases[:, None])
    turned = np.real(
        (vector / vector[np.argmax(np.abs(vector))] * phases[:, None])[:, None]
        * multiplier ** rounds[:, None]
    )
    growth = np.linalg.norm(turned, axis=2) / np.linalg.norm(real, axis=1)[:, None]
    phase, k = np.unravel_index(int(np.argmax(growth)), growth.shape)
    start = real[phase] * motion.scale
    return start / np.linalg.norm(start), int(rounds[k])


def _decaying(found: Multipliers) -> Certificate:
    """P with ``Φᵀ P Φ − P = −I`` of one integrator, and the least eigenvalue of ``P − Φᵀ P Φ`` of the other."""
    p = solve_discrete_lyapunov(found.scaled.T, np.eye(len(found.scaled)))
    p = 0.5 * (p + p.T)
    left = p - found.check.T @ p @ found.check
    slack = float(min(np.linalg.eigvalsh(0.5 * (left + left.T))[0], np.linalg.eigvalsh(p)[0]))
    return Certificate(
        "Φᵀ P Φ − P ≺ 0 and P ≻ 0 over one period, in coordinates without units", {"P": p}, slack
    )


def _undamped(found: Multipliers) -> Certificate | None:
    """One undamped axis: det Φ = 1, so the motion is bounded iff |tr Φ| < 2 (in general, < 1 + det Φ ≤ 2)."""
    with np.errstate(over="ignore", invalid="ignore"):
        slack = min(
            1 + min(float(np.linalg.det(phi)), 1.0) - abs(float(np.trace(phi)))
            for phi in (found.scaled, found.check)
        )
    if not slack > found.tolerance:
        return None
    values = {"trace": float(np.trace(found.scaled)), "determinant": float(np.linalg.det(found.scaled))}
    return Certificate("|tr Φ| < 1 + det Φ with det Φ = 1", values, slack)


def _check(mass: Source, stiffness: Source, damping: Source, period: float) -> None:
    """Refuse gains that do not repeat, and a mass or damping that is not positive."""
    sources = {"mass": mass, "stiffness": stiffness, "damping": damping}
    sizes = {name: at(name, source, 0.0).shape[-1] for name, source in sources.items()}
    if len(set(sizes.values())) > 1:
        raise InputError(
            f"the sizes differ: {', '.join(f'{n} {d} × {d}' for n, d in sizes.items())}; pass matrices of one size."
        )
    for name, source in sources.items():
        instants = period * np.linspace(0, 1, 33) if callable(source) else np.zeros(1)
        found = np.stack([at(name, source, float(t)) for t in instants])
        if name != "stiffness":
            positive_matrices(name, found, definite=name == "mass")
        if callable(source):
            for t in period * _PHASES:
                one, next_one = at(name, source, float(t)), at(name, source, float(t + period))
                if np.abs(one - next_one).max() > 1e-6 * np.abs(found).max():
                    raise InputError(
                        f"{name}({t:.6g}) and {name}({t + period:.6g}), one period later, differ; pass its period, or "
                        "a function of t % period."
                    )
