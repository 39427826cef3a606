"""Questions about the computer that sets the force: held at a period, with a hand on it, in contact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vic_toolbox.errors import Array, InputError
from vic_toolbox.gains import AXES
from vic_toolbox.stability.analysis.findings import Finding, together, worst_axis
from vic_toolbox.stability.analysis.sets import Gains
from vic_toolbox.stability.analysis.setting import Setting, extremes, stiffness_text, uncoupled
from vic_toolbox.stability.environments.contact import contact
from vic_toolbox.stability.sampling.sampled import sampled_stability
from vic_toolbox.stability.sampling.sampled_passivity import sampled_passivity
from vic_toolbox.stability.sampling.z_width import z_width
from vic_toolbox.stability.verdict import Verdict

MOST = 300
"""Gains that are judged one by one."""
LONGEST = 1e3
"""Longest period that is looked at, relative to the given one."""


def chosen(gains: Gains, setting: Setting, most: int = MOST) -> tuple[Array, Array, Array]:
    """M, K and B of the extreme samples, and of others evenly spread."""
    index = extremes(*gains, most=most)
    mass = setting.mass[index] if setting.mass.ndim == 3 else setting.mass
    return mass, gains[0][index], gains[1][index]


def held_force(gains: Gains, setting: Setting, period: float) -> Finding:
    """Every gain as if it were held for ever, at the control period."""
    mass, k, b = chosen(gains, setting)
    verdict = sampled_stability(mass, k, b, period=period, **_loop(setting))
    verdict = _of_so_many(verdict, len(k), len(gains[0]))
    worst = int(verdict.values.get("index", 0))
    one = (mass[worst] if mass.ndim == 3 else mass), k[worst], b[worst]
    limit = longest_period(*one, setting, period)
    if verdict.status == "proved":
        remedy = (
            "nothing" if limit is None else f"nothing: it would hold up to a period of {1e3 * limit:.3g} ms"
        )
        remedy += _share_of_z_width(one, setting, period)
    elif limit is None:
        remedy = "these gains are unstable at any period: give damping, and reckon with the delay"
    else:
        remedy = f"run the control loop faster than {1e3 * limit:.3g} ms, or lower damping and stiffness"
    return Finding(
        "sampled", f"Is it stable with a force that is held over {1e3 * period:.4g} ms?", verdict, remedy
    )


def _of_so_many(verdict: Verdict, judged: int, total: int) -> Verdict:
    """Say so where not all gains were judged."""
    if judged == total:
        return verdict
    note = f"{judged} of {total} gains were judged: the extremes of each axis, and others evenly spread"
    return replace(verdict, assumptions=(*verdict.assumptions, note))


def longest_period(
    mass: Array, stiffness: Array, damping: Array, setting: Setting, period: float
) -> float | None:
    """Period [s] at which a pair of gains ceases to be stable, to a percent; None if not within a factor of 1000."""

    def stable(seconds: float) -> bool:
        found = sampled_stability(mass, stiffness, damping, period=seconds, **_loop(setting))
        return found.values["spectral_radius"] < 1

    here = stable(period)
    step, edge = (2.0, period * LONGEST) if here else (0.5, period / LONGEST)
    other = period
    while stable(other) == here:
        other *= step
        if (other > edge) if here else (other < edge):
            return None
    low, high = (other / 2, other) if here else (other, 2 * other)
    while high > 1.005 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _loop(setting: Setting) -> dict:
    return {
        "physical_damping": setting.physical_damping,
        "velocity": setting.velocity,
        "delay_steps": setting.delay_steps,
    }


def _share_of_z_width(one: tuple[Array, Array, Array], setting: Setting, period: float) -> str:
    """The axis that takes most of the stiffness that its mass can render at this period; of uncoupled axes."""
    mass, k, _ = one
    if not uncoupled(mass, k, setting.physical_damping):
        return ""
    shares = []
    for i in range(len(k)):
        found = z_width_of(setting, i, float(mass[i, i]), period)
        shares.append((k.item(i, i) / found if found > 0 else 0.0, i, found))
    share, axis, largest = max(shares)
    part = f"{100 * share:.2g} %" if share >= 1e-3 else "less than 0.1 %"
    width = stiffness_text(largest, setting.unit(axis, "K"))
    return f"; {setting.gain('K', axis, k.item(axis, axis))} is {part} of the Z-width, {width}"


def z_width_of(setting: Setting, axis: int, mass: float, period: float) -> float:
    """The largest stiffness that an axis of this mass renders, whatever its damping; 0 if none."""
    try:
        found = z_width(
            mass,
            period=period,
            stiffness=[0.0, 1.0],
            damping=[0.0, 1.0],
            physical_damping=float(setting.physical_damping[axis, axis]),
            velocity=setting.velocity,
            delay_steps=setting.delay_steps,
        )
    except InputError:
        return 0.0
    return float(np.nan_to_num(found.largest[0]))


def with_any_hand(gains: Gains, setting: Setting, period: float) -> Finding:
    """Passivity of the wall that the gains make, with the friction of the mechanism."""
    index = extremes(*gains, most=MOST)
    verdict = sampled_passivity(
        gains[0][index],
        gains[1][index],
        period=period,
        delay=setting.delay_steps * period,
        physical_damping=setting.physical_damping,
    )
    verdict = _of_so_many(verdict, len(index), len(gains[0]))
    required = np.asarray(verdict.values["required_damping"])
    required = (
        required.reshape(-1, *required.shape[-2:]) if required.ndim >= 2 else required.reshape(-1, 1, 1)
    )
    needed = np.diagonal(required, axis1=1, axis2=2).max(axis=0)
    axis = int(np.argmax(needed - np.diagonal(setting.physical_damping)))
    friction = setting.gain("D", axis, float(needed.item(axis)))
    remedy = (
        "nothing: no passive environment or hand can make it unstable"
        if verdict.status == "proved"
        else f"for a guarantee with every hand: {friction} of real friction, "
        "less damping B, or a shorter period; not passive is not yet unstable"
    )
    return Finding(
        "passivity", "Is the force that the computer makes passive: safe with every hand?", verdict, remedy
    )


def touching(gains: Gains, setting: Setting) -> Finding | None:
    """Each translation against a stiff environment, with its stiffest, its most and its least damped gains."""
    axes = [i for i, name in enumerate(setting.names) if name not in AXES[3:]]
    if not axes:
        return None
    stiffness = setting.environment_stiffness
    found: dict[str, Verdict] = {}
    for i in axes:
        k, b = gains[0][:, i, i], gains[1][:, i, i]
        for j in sorted({int(k.argmax()), int(b.argmax()), int(b.argmin())}):
            mass = setting.mass[j] if setting.mass.ndim == 3 else setting.mass
            apparent = 1.0 / float(np.linalg.inv(mass)[i, i])
            verdict = contact(
                apparent,
                float(k[j]),
                float(b[j]),
                kind="impedance",
                environment_stiffness=stiffness,
                environment_damping=float(setting.physical_damping[i, i]),
                delay=0.0 if setting.period is None else setting.delay_steps * setting.period,
                period=setting.period,
            )
            name = setting.names[i]
            if name not in found or verdict.margin < found[name].margin or verdict.status == "disproved":
                found[name] = verdict
    verdict = together(found, question=f"impedance control on an environment of {stiffness:g} N/m: stable?")
    note = (
        "friction of the mechanism acts beside the environment; each axis alone with its apparent mass, at its "
        "stiffest, its most and its least damped gains"
    )
    verdict = replace(verdict, assumptions=(*verdict.assumptions, note))
    most = min(float(v.values["max_environment_stiffness"]) for v in found.values())
    limit = "whatever its stiffness" if math.isinf(most) else f"up to {stiffness_text(most)}"
    remedy = (
        f"nothing: stable on every environment {limit}"
        if verdict.status == "proved"
        else f"touch nothing stiffer than {stiffness_text(most)}, add damping, or shorten period and delay"
    )
    return Finding(
        "contact",
        f"Is contact with something of {stiffness_text(stiffness)} stable?",
        verdict,
        remedy,
        shown=found[worst_axis(found)],
    )
