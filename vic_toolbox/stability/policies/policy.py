r"""Stability of a policy K(e, ė), B(e, ė): linearised with its gain gradients, and searched for growing motions.

Positive definite gains do not make a policy stable. The arm feels the slope of the wrench, not K and B (see
:mod:`~vic_toolbox.stability.policies.policy_jacobian`):

- a stiffness that falls with the error holds no more than a largest force, and pushes outward beyond it;
- a stiffness that falls with the speed takes damping away, wherever a load keeps the error from zero;
- gains of one axis that depend on another make a spring without a potential, which gives energy on closed paths.

What can be proved of a black box is local: if its gains are continuous at an equilibrium without load (with one:
differentiable), and the linearised loop decays, then so does every motion that starts close enough (Lyapunov's
indirect method). A box of starts can be disproved by a motion that grows, but samples alone prove nothing about it.

References
----------
H. K. Khalil, "Nonlinear Systems", 3rd ed., Prentice Hall, 2002, theorem 4.7 and section 8.2.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, integer
from vic_toolbox.gains import Parametrisation
from vic_toolbox.stability.policies.growing_trajectory import LASTING, grown_example, search_growth
from vic_toolbox.stability.policies.held_force import equilibrium as find_equilibrium
from vic_toolbox.stability.policies.policy_local import LocalLoop
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.policies.policy_overload import carried_off
from vic_toolbox.stability.policies.policy_range import range_certificate
from vic_toolbox.stability.policies.policy_scan import (
    PolicyScan,
    refused_gains,
    region_box,
    region_starts,
    visited_states,
)
from vic_toolbox.stability.policies.region_of_attraction import region_of_attraction
from vic_toolbox.stability.verdict import Certificate, CounterExample, Status, Verdict

EDGE = 3e-3
"""Growth rate, relative to the loop's fastest frequency, that is too near the edge for a verdict."""

SUSPICIOUS = 1.2
"""Growth in the search from which a motion is integrated again."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def policy_stability(
    policy: Any,
    mass: ArrayLike,
    *,
    damping: ArrayLike | None = None,
    parametrisation: Parametrisation | None = None,
    output: Literal["gains", "wrench"] = "gains",
    history: int = 1,
    load: ArrayLike | None = None,
    region: ArrayLike | None = None,
    rollout: ArrayLike | None = None,
    samples: int = 64,
    seed: int = 0,
) -> Verdict:
    r"""Is the closed loop ``M ë + B(e,ė) ė + K(e,ė) e = load`` of a policy stable?

    Without a region the question is local: does every motion that starts close enough to the equilibrium return to
    it? With a region (or a rollout, whose extent is the region) it is about every start in that box; it can then be
    disproved by a growing motion, and is *inconclusive* otherwise, with what the samples show.

    Parameters
    ----------
    policy : callable or object
        Observations (n, 2 d) = ``[e, ė]`` to gains, actions or wrenches: see
        :class:`~vic_toolbox.stability.policies.policy_loop.PolicyLoop`, also for `damping`, `parametrisation`,
        `output` and `history`.
    mass : array_like
        M: a number (one axis), or (d, d) symmetric positive definite.
    load : array_like, optional
        Constant wrench (d,) that pushes on the arm [N, Nm], which is −F_ext; zero by default.
    region : array_like, shape (2 d,), optional
        Half widths of the box of starts: errors [m, rad], then rates [m/s, rad/s].
    rollout : array_like, shape (n, 2 d · history), optional
        Observations of the policy at work. The analysis is also made along them.
    samples : int
        Motions in the first round of the search.
    seed : int
        Of all samples.

    Returns
    -------
    Verdict
        Its margin is the slowest decay at the equilibrium [1/s], or minus the rate of the growing motion. `values`:

        ``equilibrium``
            e at rest under the load (d,).
        ``growth_rate``, ``eigenvalues``
            Largest real part [1/s], and all eigenvalues, of the loop linearised there.
        ``effective_stiffness``, ``effective_damping``
            Smallest eigenvalue of the symmetric parts of S and E: there, or at the worst sample of a region.
        ``curl``
            Largest ``∂w_i/∂e_j − ∂w_j/∂e_i``, there or at the worst sample.

        and for a region

        ``largest_force``, ``largest_force_error``, ``largest_force_at_edge``
            See :func:`~vic_toolbox.stability.policies.held_force.largest_force`.
        ``loop_energy``, ``loop_plane``
            Energy that a slow turn on the ellipse of half the region gives [J], in the worst plane.
        ``attraction_share``, ``attraction_semi_axes``
            See :class:`~vic_toolbox.stability.policies.region_of_attraction.AttractionRegion`.
        ``search_growth``, ``search_settled``, ``search_refused``, ``search_count``
            See :class:`~vic_toolbox.stability.policies.growing_trajectory.Search`.
        ``inadmissible_share``
            Share of the samples at which K or B is not positive.
        ``rollout_stiffness_power``
            Largest ``½ eᵀ K̇ e`` along the rollout [W], with the total derivative of K.

    Raises
    ------
    InputError
        Arguments that do not fit, a policy that fails or returns NaN or another shape, or gains that are not
        positive at the equilibrium.
    """
    loop = PolicyLoop(
        policy,
        mass,
        damping=damping,
        parametrisation=parametrisation,
        output=output,
        history=history,
        load=load,
    )
    generator = np.random.default_rng(integer("seed", seed, low=0))
    count = integer("samples", samples, low=2)
    visited = visited_states(rollout, loop)
    box = region_box(region, visited, loop)
    if box is None and loop.output == "wrench":
        raise InputError(
            "a wrench has no scale of its own; pass the region in which the policy works, or a rollout."
        )
    scanned = None if box is None else PolicyScan.of(loop, box, visited, generator)
    rest = find_equilibrium(loop, reach=None if box is None else box[: loop.size])
    values: dict[str, Any] = {} if scanned is None else scanned.values
    if rest is None:
        return _without_equilibrium(loop, box, values)
    local = LocalLoop.at(loop, rest, box)
    values = local.values | values
    question = _question(loop, box)

    def verdict(status: Status, **parts: Any) -> Verdict:
        return _verdict(loop, question, values, status, local=local, **parts)

    if local.rate > EDGE * local.frequency:
        example = local.growing(loop, box)
        if example is not None:
            return verdict("disproved", margin=-local.rate, witness=example)
        return verdict(
            "inconclusive",
            margin=-local.rate,
            reason="the linearised loop grows, but no motion with admissible gains grows far enough to show it.",
        )
    whole = range_certificate(loop)
    if whole is not None:
        question = _question(
            loop, None, where="anywhere, with any gains in the range of the parametrisation,"
        )
        return _verdict(loop, question, values, "proved", margin=whole[1], witness=whole[0], anyhow=True)
    certificate = local.certificate(loop)
    if box is None or scanned is None:
        return _local_verdict(loop, local, certificate, verdict)
    if certificate is not None:
        found = region_of_attraction(loop, rest, certificate.values["P"], region=box, generator=generator)
        values |= {"attraction_share": found.share, "attraction_semi_axes": found.semi_axes}
    starts = region_starts(box, count, visited, generator)
    worst = search_growth(
        loop,
        starts,
        equilibrium=rest,
        stiffness=local.spring,
        region=box,
        slowest=local.slowest,
        generator=generator,
    )
    values |= {
        "search_growth": worst.growth,
        "search_settled": worst.settled,
        "search_refused": worst.refused,
        "search_count": worst.count,
    }
    for start in worst.starts[: 3 if worst.growth > SUSPICIOUS else 0]:
        example = grown_example(
            loop,
            start,
            equilibrium=rest,
            stiffness=local.spring,
            duration=max(2 * worst.duration, LASTING * local.slowest),
            description="from a start in the region the motion grows",
        )
        if example is not None:
            rate = np.log(example.energy[-1] / example.energy[0]) / (2 * example.time[-1])
            return verdict("disproved", margin=-float(rate), witness=example)
    said = "decays near the equilibrium (local proof)" if certificate else "is not shown to decay"
    return verdict(
        "inconclusive",
        margin=-local.rate,
        witness=certificate,
        reason=f"the loop {said}, and none of {worst.count} motions from the region was seen to grow for good; "
        f"samples prove nothing about the rest of it. {scanned.warning}".strip(),
    )


def _local_verdict(
    loop: PolicyLoop, local: LocalLoop, certificate: Certificate | None, verdict: Any
) -> Verdict:
    reason = refused_gains(loop)
    if reason:
        pass
    elif certificate is None or -local.rate < EDGE**2 * local.frequency:
        reason = "the linearised loop is at the edge: neither its decay nor its growth is certain."
    elif not local.continuous:
        reason = "the gains jump at the equilibrium, so linearising there says nothing."
    elif certificate.slack < 0:
        reason = (
            "the gain gradients at the equilibrium are too uncertain (a kink?) to prove that the loop decays."
        )
    if reason:
        return verdict("inconclusive", margin=-local.rate, reason=reason)
    return verdict(
        "proved",
        margin=-local.rate,
        witness=certificate,
        reason="local: how far from the equilibrium this holds is not known; give a region to look at it.",
    )


def _without_equilibrium(loop: PolicyLoop, box: Array | None, values: dict[str, Any]) -> Verdict:
    question, example = _question(loop, box), carried_off(loop, box)
    if example is None:
        reason = "no equilibrium under this load was found in the region, and no motion from rest grows."
        return _verdict(loop, question, values, "inconclusive", reason=reason)
    return _verdict(loop, question, values, "disproved", witness=example)


def _verdict(
    loop: PolicyLoop,
    question: str,
    values: dict[str, Any],
    status: Status,
    *,
    margin: float = float("nan"),
    witness: Certificate | CounterExample | None = None,
    reason: str = "",
    local: LocalLoop | None = None,
    anyhow: bool = False,
) -> Verdict:
    """Build the verdict; `anyhow`: it holds however the gains change within their range."""
    assumptions = ["the mass is constant, and nothing but the load acts on the arm"]
    if loop.size > 3:
        assumptions.append("rotation errors are small enough that ė is the derivative of e")
    if status == "proved" and not anyhow:
        loaded = local is not None and bool(local.rest.any())
        assumptions.append(f"the gains are {'differentiable' if loaded else 'continuous'} at the equilibrium")
    if loop.history > 1 and not anyhow:
        assumptions.append(
            f"the arm moves slowly against the {loop.history} observations that the policy sees"
        )
        if status != "inconclusive":
            word = {"proved": "decays", "disproved": "grows"}[status]
            reason = f"without its memory the policy's loop {word}; what {loop.history} observations do to it is open."
            status = "inconclusive"
    return Verdict(
        status=status,
        question=question,
        method="closed loop linearised with the gain gradients, search for a growing motion (Khalil, theorem 4.7)",
        margin=margin,
        margin_unit="1/s, "
        + ("guaranteed decay" if anyhow else "slowest decay at the equilibrium (negative: growth)"),
        values=values,
        witness=witness,
        assumptions=tuple(assumptions),
        reason=reason,
    )


def _question(loop: PolicyLoop, box: Array | None, *, where: str = "") -> str:
    load = f"load {np.array2string(loop.load, precision=4)}" if loop.load.any() else "0"
    pull = "K(e,ė) e + B(e,ė) ė" if loop.output == "gains" else "B ė − F_fb(e,ė)"
    if not where:
        where = (
            "close enough to the equilibrium (local)"
            if box is None
            else f"with |[e, ė]| ≤ {np.array2string(box, precision=4, max_line_width=200)}"
        )
    return f"does every motion of M ë + {pull} = {load} that starts {where} return to the equilibrium?"
