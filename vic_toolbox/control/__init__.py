"""Control of an arm's end-effector: the impedance law, the force law, nullspaces and designed experts.

The NumPy law (:mod:`~vic_toolbox.control.law`) is the reference; :mod:`~vic_toolbox.control.compiled` is the
same law as compiled code for a simulator, and is imported only where it is needed. What a law does to an arm
shows :mod:`~vic_toolbox.control.closed_loop`. Gains that change pass through a runtime filter
(:mod:`~vic_toolbox.control.energy_tank`, :mod:`~vic_toolbox.control.gain_filter`) before the law uses them.
"""

from __future__ import annotations

from vic_toolbox.control.closed_loop import Motion, simulate
from vic_toolbox.control.energy_tank import EnergyTank, TankState
from vic_toolbox.control.experts import ConstantGains, Expert, ThreePhaseExpert, TipStiffnessExpert
from vic_toolbox.control.filter_replay import FilterReplay, replay_filter
from vic_toolbox.control.gain_filter import FilterState, GainFilter
from vic_toolbox.control.law import CartesianLaw, Command, Reference, feedback_wrench, feedforward_wrench
from vic_toolbox.control.nullspace import Posture, dynamically_consistent_inverse, nullspace_projector

__all__ = [
    "CartesianLaw",
    "Command",
    "ConstantGains",
    "EnergyTank",
    "Expert",
    "FilterReplay",
    "FilterState",
    "GainFilter",
    "Motion",
    "Posture",
    "Reference",
    "TankState",
    "ThreePhaseExpert",
    "TipStiffnessExpert",
    "dynamically_consistent_inverse",
    "feedback_wrench",
    "feedforward_wrench",
    "nullspace_projector",
    "replay_filter",
    "simulate",
]
