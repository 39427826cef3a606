"""Which column is what, guessed from its name: ``f_x``, ``wrench.force.x``, ``pos_x_des``, ``qw``, ``joint_3``, ...

A name is split into words; every word has to mean something, else the column is left alone. A guess is never
silent: it becomes a note of the recording.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

QUANTITIES = {
    "force": "f force forces ftx",
    "moment": "m moment moments torque torques tau mom",
    "position": "p pos position translation xyz",
    "quaternion": "q quat quaternion orientation rot rotation ori",
    "axis": "u axis",
    "angle": "theta angle",
    "rotation_vector": "r rv rotvec",
    "velocity": "v vel velocity linear",
    "angular": "omega angular",
    "joint": "joint joints",
    "time": "time t timestamp stamp secs sec seconds clock",
    "wrench": "wrench ft",
    "roll": "roll",
    "pitch": "pitch",
    "yaw": "yaw",
}
MEANING = {word: quantity for quantity, words in QUANTITIES.items() for word in words.split()}
REFERENCE_WORDS = (
    "0 d des desired ref reference cmd command commanded goal target setpoint sp equilibrium attractor"
)
CONTEXT_WORDS = """
pose ee eef tcp tool end effector endeffector robot arm base world actual act measured meas msr current cartesian cart
data sensor state states header ext external vec wxyz xyzw n nm rad
"""
REFERENCE = frozenset(REFERENCE_WORDS.split())
CONTEXT = frozenset(CONTEXT_WORDS.split())
COUNTED = ("joint", "joint velocity", "wrench", "quaternion")
UNIT = re.compile(r"[\[(].*?[\])]")
GLUED = re.compile(
    r"(?P<quantity>force|moment|torque|pos|quat|tau|[fmtpqurvk])?(?P<axis>[wxyz])(?P<reference>0|d|des|ref|cmd)?"
)
NUMBERED = re.compile(r"(?P<quantity>q|dq|joint|j|u|theta|wrench|ft)(?P<number>\d+|d|ref)")


class Meaning(NamedTuple):
    """What a column is."""

    quantity: str
    axis: str
    reference: bool


def guess_columns(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Fields of a layout that the names of the columns give away.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    dict
        Column names by field, for every field whose columns are all there. A meaning that two columns claim
        goes to the first.
    """
    column: dict[Meaning, str] = {}
    for name in names:
        if (meaning := _meaning(name)) is not None:
            column.setdefault(meaning, name)

    def group(quantity: str, axes: str, reference: bool = False) -> tuple[str, ...]:
        found = [column.get(Meaning(quantity, axis, reference)) for axis in axes]
        return tuple(name for name in found if name is not None) if None not in found else ()

    fields: dict[str, tuple[str, ...]] = {
        "time": group("time", " "),
        "wrench": _wrench(group("force", "xyz"), group("moment", "xyz")) or group("wrench", "012345"),
    }
    for prefix, reference in (("", False), ("reference_", True)):
        fields[f"{prefix}position"] = group("position", "xyz", reference)
        orientations = {
            "quat_wxyz": group("quaternion", "wxyz", reference),
            "axis_angle": _both(group("axis", "xyz", reference), group("angle", " ", reference)),
            "rotation_vector": group("rotation_vector", "xyz", reference),
            "roll_pitch_yaw": sum((group(q, " ", reference) for q in ("roll", "pitch", "yaw")), ()),
        }
        for kind, found in orientations.items():
            if found and (kind != "roll_pitch_yaw" or len(found) == 3):
                fields[f"{prefix}{kind}"] = found
                break
        fields[f"{prefix}twist"] = _both(
            group("velocity", "xyz", reference), group("angular", "xyz", reference)
        )
    for field, quantity in (("joint_position", "joint"), ("joint_velocity", "joint velocity")):
        joints = [meaning for meaning in column if meaning.quantity == quantity]
        fields[field] = tuple(
            column[meaning] for meaning in sorted(joints, key=lambda joint: int(joint.axis))
        )
    return {field: found for field, found in fields.items() if found}


def names_reference(topic: str) -> bool:
    """Whether the name of a topic says that it is wanted rather than measured."""
    return not REFERENCE.isdisjoint(_words(topic))


def _wrench(force: tuple[str, ...], moment: tuple[str, ...]) -> tuple[str, ...]:
    return force + moment if force else ()


def _both(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[str, ...]:
    return first + second if first and second else ()


def _words(name: str) -> list[str]:
    name = UNIT.sub(" ", name)
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word]


def _meaning(name: str) -> Meaning | None:
    """What a column is, or None where a word of its name says nothing."""
    quantities: list[str] = []
    axis, reference = " ", False
    for word in _words(name[:200]):
        numbered = word.isdecimal() and bool(quantities) and quantities[-1] in COUNTED
        if word in ("w", "x", "y", "z") or numbered:
            axis = word
        elif word in REFERENCE:
            reference = True
        elif word in MEANING:
            quantities.append(MEANING[word])
        elif word in ("dq", "qd", "qdot"):
            quantities.append("joint velocity")
        elif match := GLUED.fullmatch(word):
            axis, reference = match["axis"], reference or match["reference"] is not None
            quantity = match["quantity"]
            if quantity == "k":
                return None
            if quantity:
                quantities.append("moment" if quantity == "t" else MEANING[quantity])
        elif match := NUMBERED.fullmatch(word):
            quantity = match["quantity"]
            if quantity in ("u", "theta"):
                quantities.append(MEANING[quantity])
                reference = True
            else:
                quantities.append(
                    {"q": "joint", "j": "joint", "joint": "joint", "dq": "joint velocity"}.get(
                        quantity, "wrench"
                    )
                )
                axis = match["number"]
        elif word not in CONTEXT:
            return None
    return _settled(quantities, axis, reference)


def _settled(quantities: list[str], axis: str, reference: bool) -> Meaning | None:
    """The last quantity says it; those before are its context, as in ``wrench.force.x``."""
    if not quantities:
        return Meaning("position", axis, reference) if axis in "xyz" else None
    quantity = quantities[-1]
    if "joint" in quantities and quantity in ("position", "velocity"):
        quantity = "joint" if quantity == "position" else "joint velocity"
    if quantity == "quaternion" and axis.isdecimal():  # q_1 ... q_7: joints; four of them may be a quaternion
        quantity = "joint"
    if quantity in ("time", "angle", "roll", "pitch", "yaw"):
        return Meaning(quantity, " ", reference) if axis == " " else None
    if quantity in ("joint", "joint velocity", "wrench"):
        return Meaning(quantity, axis, False) if axis.isdecimal() and not reference else None
    allowed = "wxyz" if quantity == "quaternion" else "xyz"
    return Meaning(quantity, axis, reference) if axis in allowed else None
