"""Questions about a set of gains: is any change among them safe, and how far may they go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.stability.analysis.findings import Finding, together, worst_axis
from vic_toolbox.stability.analysis.setting import Setting, extremes, listed, uncoupled
from vic_toolbox.stability.ranges.common_lyapunov import common_lyapunov
from vic_toolbox.stability.ranges.safe_range import safe_range
from vic_toolbox.stability.ranges.switching import worst_case_switching
from vic_toolbox.stability.verdict import Certificate, Verdict

FEW = {True: 24, False: 10}
"""Gains that a common Lyapunov function is first looked for with: of axes on their own, or coupled."""
ADDED, ROUNDS = 4, 6
"""Gains that are added where the function does not hold, and how often."""

Gains = tuple[Array, Array]


def any_switching(members: Gains, setting: Setting, *, cover: Gains | None, named: str) -> Finding:
    """One Lyapunov function for all; a set whose hull is not known is never proved."""
    question = f"Is any change safe, however fast, among {named}?"
    verdict = hull(setting.mass, *members)
    if verdict.status == "proved":
        if cover is None:
            verdict = replace(
                verdict,
                status="inconclusive",
                witness=None,
                reason=f"one Lyapunov function serves all {len(members[0])} extreme gains looked at, but what lies "
                "between is not their hull",
            )
        elif cover is not members:
            wider = hull(setting.mass, *cover)
            verdict = (
                wider
                if wider.status == "proved"
                else replace(
                    verdict,
                    status="inconclusive",
                    witness=None,
                    reason="one Lyapunov function serves the corners, but not the whole range",
                )
            )
    return Finding("switching", question, verdict, _switching_remedy(verdict))


def _switching_remedy(verdict: Verdict) -> str:
    if verdict.status == "proved":
        return f"nothing: every motion decays at least at {verdict.margin:.2g} 1/s, whatever a policy does in here"
    if verdict.status == "disproved":
        return "do not switch freely: narrow the range, give more damping, or filter the gains"
    return "nothing is proved: narrow the range, or rely on how the gains really change (schedule)"


def hull(mass: Array, stiffness: Array, damping: Array) -> Verdict:
    """:func:`common_lyapunov` of many gains: of few of them, then checked on all, with those added that fail."""
    masses = np.broadcast_to(mass, stiffness.shape)
    apart = uncoupled(mass, stiffness, damping)
    chosen = extremes(stiffness, damping, most=FEW[apart])
    total = len(stiffness)
    for _ in range(ROUNDS):
        one_mass = mass if mass.ndim == 2 else masses[chosen]
        verdict = common_lyapunov(one_mass, stiffness[chosen], damping[chosen])
        if verdict.status != "proved" or len(chosen) == total:
            return verdict
        assert isinstance(verdict.witness, Certificate)
        rates = decay(verdict.witness.values["P"], masses, stiffness, damping)
        if rates.min() > 0:
            slowest = float(rates.min())
            certificate = replace(verdict.witness, slack=slowest)
            return replace(
                verdict,
                margin=slowest,
                values=dict(verdict.values) | {"decay_rate": slowest},
                witness=certificate,
                question=f"M ë + D ė + K e = 0 with gains that change anyhow within the hull of {total} gains: stable?",
            )
        chosen = np.union1d(chosen, np.argsort(rates)[:ADDED])
    return replace(
        verdict,
        status="inconclusive",
        witness=None,
        margin=float("nan"),
        reason=f"no common Lyapunov function was found that serves all {total} gains",
    )


def decay(matrix: Array, mass: Array, stiffness: Array, damping: Array) -> Array:
    """Rate (n,) [1/s] at which ``[e; ė]ᵀ P [e; ė]`` is sure to fall: as ``exp(−2 rate t)``."""
    n, d = len(stiffness), stiffness.shape[-1]
    systems = np.zeros((n, 2 * d, 2 * d))
    systems[:, :d, d:] = np.eye(d)
    systems[:, d:, :d] = -np.linalg.solve(mass, stiffness)
    systems[:, d:, d:] = -np.linalg.solve(mass, damping)
    factor = np.linalg.cholesky(matrix)
    turned = factor.T @ systems @ np.linalg.inv(factor.T)
    rates = -np.linalg.eigvalsh(0.5 * (turned + np.swapaxes(turned, 1, 2)))[:, -1]
    return np.asarray(rates, dtype=np.float64)


def axis_ranges(stiffness: Array, damping: Array) -> tuple[Array, Array, Array]:
    """Lowest and highest stiffness and lowest damping of each axis, (d,) each."""
    k, b = (np.diagonal(a, axis1=1, axis2=2) for a in (stiffness, damping))
    return k.min(axis=0), k.max(axis=0), b.min(axis=0)


def worst_switching(gains: Gains, setting: Setting) -> Finding | None:
    """Each axis alone, exactly: the worst k(t) in its range at its lowest damping; None if no stiffness is there."""
    low, high, least = axis_ranges(*gains)
    masses = np.diagonal(setting.mass)
    axes = [i for i in range(len(low)) if high[i] > 0]
    if not axes:
        return None
    found = {
        setting.names[i]: worst_case_switching(
            float(masses[i]), (float(low[i]), float(high[i])), float(least[i])
        )
        for i in axes
    }
    verdict = together(
        found, question="m ë + b(t) ė + k(t) e = 0 on each axis, k and b anywhere in its range: bounded?"
    )
    note = "the damping is taken at its lowest, which is the worst: more damping turns no motion outward"
    verdict = replace(verdict, assumptions=(*verdict.assumptions, note))
    worst = setting.names.index(verdict.values["worst_axis"])
    needed = setting.gain("B", worst, verdict.values["critical_damping"])
    remedy = (
        f"nothing: tightest is {setting.gain('B', worst, least[worst])}, and {needed} would be enough"
        if verdict.status == "proved"
        else f"give more damping than {needed}, or a narrower range of stiffness"
    )
    question = "Is the very worst change of each axis' stiffness safe (exact)?"
    return Finding("worst switching", question, verdict, remedy, shown=found[worst_axis(found)])


def decided_exactly(switching: Finding, worst: Finding, members: Gains, setting: Setting) -> Finding:
    """Where no common Lyapunov function decides, the exact worst case of every axis does.

    If it is harmless, so is every change in the ranges; if it is not, it has to be among the gains that can occur.
    """
    if switching.status != "inconclusive" or worst.status == "inconclusive":
        return switching
    if worst.status == "disproved":
        axis = setting.names.index(worst.verdict.values["worst_axis"])
        k, b = (a[:, axis, axis] for a in members)
        at = {float(x) for x in k[b == b.min()]}
        if not {float(k.min()), float(k.max())} <= at:
            return switching
    return replace(
        switching,
        verdict=worst.verdict,
        remedy=worst.remedy,
        tried=(switching.verdict, *switching.tried),
        shown=worst.shown,
    )


def how_far(gains: Gains, setting: Setting) -> Finding | None:
    """How far the stiffness of each axis may rise above its lowest; None where it may be zero."""
    low, high, least = axis_ranges(*gains)
    masses = np.diagonal(setting.mass)
    if (low <= 0).any():
        return None
    found = {
        name: safe_range(float(masses[i]), float(low[i]), float(least[i]))
        for i, name in enumerate(setting.names)
    }
    verdict = together(found, question="the largest range from k_low up in which k(t) may change anyhow")
    factors = {name: float(v.values["factor"]) for name, v in found.items()}
    short = [n for i, n in enumerate(setting.names) if not factors[n] * low[i] >= high[i]]
    beyond = min(factors[n] * low[i] / high[i] for i, n in enumerate(setting.names)) - 1
    verdict = replace(verdict, margin=beyond, margin_unit="times the highest stiffness, beyond it")
    ends = [
        f"{setting.gain('K', i, factors[n] * low[i])}"
        for i, n in enumerate(setting.names)
        if factors[n] < 1e6
    ]
    where = (
        f"safe up to {', '.join(ends)}"
        if ends
        else "safe without end: the damping is enough for any stiffness"
    )
    remedy = f"too wide for {listed(short)}; {where}" if short else where
    return Finding(
        "safe range",
        "How far may the stiffness go, from its lowest up, and change anyhow?",
        verdict,
        remedy,
        shown=found[worst_axis(found)],
    )
