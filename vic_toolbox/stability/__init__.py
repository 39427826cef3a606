"""Impedance stability: a verdict, a margin and a witness.

Every method answers with a :class:`Verdict`. docs/stability.md says which question each one answers.
"""

from __future__ import annotations

from vic_toolbox.stability.analyse import analyse
from vic_toolbox.stability.analysis.findings import Analysis, Finding
from vic_toolbox.stability.arms.arm import arm_passivity
from vic_toolbox.stability.arms.inertia_passivity import inertia_passivity
from vic_toolbox.stability.arms.orientation_stiffness import orientation_stiffness
from vic_toolbox.stability.arms.path_inertia import path_inertia
from vic_toolbox.stability.environments.contact import Contact, contact
from vic_toolbox.stability.environments.port_passivity import port_passivity
from vic_toolbox.stability.policies.policy import policy_stability
from vic_toolbox.stability.ranges.common_lyapunov import common_lyapunov
from vic_toolbox.stability.ranges.gain_box import gain_box
from vic_toolbox.stability.ranges.safe_range import safe_range
from vic_toolbox.stability.ranges.switching import worst_case_switching
from vic_toolbox.stability.sampling.sampled import sampled_stability
from vic_toolbox.stability.sampling.sampled_passivity import sampled_passivity
from vic_toolbox.stability.sampling.z_width import ZWidth, z_width
from vic_toolbox.stability.schedules.alpha_schedule import alpha_schedule
from vic_toolbox.stability.schedules.floquet import floquet
from vic_toolbox.stability.schedules.held_gains import held_gains
from vic_toolbox.stability.schedules.kb_map import KbMap, kb_map
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.moving_mass import moving_mass
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

__all__ = [
    "Analysis",
    "Certificate",
    "Contact",
    "CounterExample",
    "Finding",
    "KbMap",
    "Verdict",
    "ZWidth",
    "alpha_schedule",
    "analyse",
    "arm_passivity",
    "common_lyapunov",
    "contact",
    "floquet",
    "gain_box",
    "held_gains",
    "inertia_passivity",
    "kb_map",
    "kronander_billard",
    "moving_mass",
    "orientation_stiffness",
    "path_inertia",
    "policy_stability",
    "port_passivity",
    "safe_range",
    "sampled_passivity",
    "sampled_stability",
    "smallest_damping",
    "worst_case_switching",
    "z_width",
]
