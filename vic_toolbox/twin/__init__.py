"""A digital twin of the arm of Cup-on-Plate: another robot than the model says, to be guided by hand or to run gains.

It is a simulation, and is called a twin everywhere: no number from it was measured on a real robot.
"""

from __future__ import annotations

from vic_toolbox.twin.calibration import calibrate
from vic_toolbox.twin.comparison import HEAD, Comparison, GainScore, compare, compare_session
from vic_toolbox.twin.deployment import Deployment, lead, run
from vic_toolbox.twin.excitation import Excitation
from vic_toolbox.twin.guiding import Session, guide
from vic_toolbox.twin.operator import CALM, Operator, Schedule
from vic_toolbox.twin.parameters import Imperfections, Specimen
from vic_toolbox.twin.robot import Twin
from vic_toolbox.twin.session import load_session, save_session, session_paths
from vic_toolbox.twin.truth import Truth

__all__ = [
    "CALM",
    "HEAD",
    "Comparison",
    "Deployment",
    "Excitation",
    "GainScore",
    "Imperfections",
    "Operator",
    "Schedule",
    "Session",
    "Specimen",
    "Truth",
    "Twin",
    "calibrate",
    "compare",
    "compare_session",
    "guide",
    "lead",
    "load_session",
    "run",
    "save_session",
    "session_paths",
]
