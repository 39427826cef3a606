"""Recordings of pose, reference and wrench: a typed record, its readers, its validation and its conditioning."""

from vic_toolbox.recordings.filtering import acceleration, differentiate
from vic_toolbox.recordings.frame import FrameCheck, check_frame
from vic_toolbox.recordings.inertia_share import inertia_share
from vic_toolbox.recordings.inspection import Inspection, inspect
from vic_toolbox.recordings.latency import Latency, find_latency, shift_wrench
from vic_toolbox.recordings.layout import Layout
from vic_toolbox.recordings.payload import (
    Payload,
    compensate_inertia,
    compensate_payload,
    identify_payload,
    static_poses,
    subtract_bias,
)
from vic_toolbox.recordings.reading import read
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.repairs import repair
from vic_toolbox.recordings.transport import wrench_to_world
from vic_toolbox.recordings.validation import Finding

__all__ = [
    "Finding",
    "FrameCheck",
    "Inspection",
    "Latency",
    "Layout",
    "Payload",
    "Recording",
    "acceleration",
    "check_frame",
    "compensate_inertia",
    "compensate_payload",
    "differentiate",
    "find_latency",
    "identify_payload",
    "inertia_share",
    "inspect",
    "read",
    "repair",
    "shift_wrench",
    "static_poses",
    "subtract_bias",
    "wrench_to_world",
]
