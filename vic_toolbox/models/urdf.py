"""From a URDF to a serial arm in Pinocchio: fingers locked, endless joints made angles, a tool attached."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from vic_toolbox.errors import FileError, ModelError

FINGER = re.compile("finger|gripper|jaw|knuckle|thumb", re.IGNORECASE)
"""Joints whose name says so, and everything beyond them, belong to a hand and are locked."""

END_EFFECTOR = [re.compile(p) for p in ("tcp", "tool0", "tool", "end_effector|eef|ee_link", "gripper_frame")]
"""Names of end-effector frames, the surest first, for a URDF that comes without a robot.toml."""

UNBOUNDED = "1e300"  # the URDF parser knows no infinity


def read_urdf(path: Path, *, locked: Collection[str] = ()) -> pin.Model:
    """Read a URDF with a fixed base, armature zero.

    A continuous joint becomes a revolute one without limits, so that every revolute joint has one angle (nq =
    nv), as in MuJoCo. The `locked` joints become fixed ones, at zero.

    Raises
    ------
    FileError
        The file cannot be read.
    ModelError
        It is not a URDF.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise FileError(f"cannot read {path} ({error.strerror}); pass the path of a URDF.") from error
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise ModelError(f"{path} is not XML ({error}); pass the path of a URDF.") from error
    if root.tag != "robot" or not root.get("name"):
        raise ModelError(f"{path} has no <robot name=...>; pass a URDF (run xacro on a template first).")
    for joint in root.iter("joint"):
        if joint.get("name") in locked:
            joint.set("type", "fixed")
        elif joint.get("type") == "continuous":
            _unroll(joint)
    try:
        model = pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
    except Exception as error:  # Pinocchio raises ValueError, RuntimeError and more for a malformed robot
        raise ModelError(f"Pinocchio cannot read {path} ({error}); correct the URDF.") from error
    for limit in (model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit, model.effortLimit):
        limit[np.abs(limit) >= float(UNBOUNDED)] *= np.inf
    return model


@dataclass(frozen=True)
class SerialArm:
    """The serial arm of a URDF."""

    model: pin.Model
    """Joints of the arm only, armature zero."""
    tip: str
    """A frame at the end of the chain, see :data:`END_EFFECTOR`."""
    locked: tuple[str, ...]
    """Joints of the URDF that were locked at zero."""


def read_arm(path: Path) -> SerialArm:
    """Read the serial arm of a URDF, with the joints of its hand locked.

    The arm is the unbranched chain of joints from the base up to the first branching or the first joint whose
    name speaks of a hand (:data:`FINGER`). What hangs beyond keeps its mass and is locked at zero; joints
    beyond that no name calls fingers may be no more than the chain has. Mimic joints are read as plain
    joints; they only occur in hands.

    Raises
    ------
    FileError, ModelError
        As :func:`read_urdf`, or the URDF holds no serial arm (it branches at the base, a leg for instance).
    """
    model = read_urdf(path)
    chain = _chain(model)
    others = [joint for joint in range(1, model.njoints) if joint not in chain]
    bodies = [joint for joint in others if not _belongs_to_hand(model, joint)]
    if not chain or len(bodies) > len(chain):
        raise ModelError(
            f"{path} holds no serial arm: {len(chain)} joints form a chain from the base and {len(bodies)} "
            f"others branch off ({', '.join(model.names[j] for j in bodies[:4])}...); pass a URDF of one arm."
        )
    odd = [model.names[j] for j in chain if model.joints[j].nq != 1]
    if odd:
        raise ModelError(
            f"{path}: joints {odd} are neither revolute nor prismatic; pass an arm of such joints."
        )
    locked = tuple(model.names[joint] for joint in others)
    return SerialArm(read_urdf(path, locked=locked) if locked else model, _tip(model, chain[-1]), locked)


def attach_tool(arm: pin.Model, mount: str, *, tool: Path) -> pin.Model:
    """Return the arm with the links of a rigid tool, whose root link coincides with the frame `mount`.

    Raises
    ------
    FileError, ModelError
        As :func:`read_urdf`, or the tool has joints that move, or a link of the same name as one of the arm.
    """
    rigid = read_urdf(tool)
    if rigid.nq:
        raise ModelError(f"{tool} moves ({', '.join(rigid.names[1:])}); fix these joints: a tool is rigid.")
    taken = sorted({f.name for f in arm.frames[1:]} & {f.name for f in rigid.frames[1:]})
    if taken:
        raise ModelError(f"{tool} repeats the names {taken} of the arm; rename them in one of the two.")
    return pin.appendModel(arm, rigid, arm.getFrameId(mount), pin.SE3.Identity())


def _unroll(joint: ElementTree.Element) -> None:
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ElementTree.SubElement(joint, "limit")
    limit.attrib.update(lower=f"-{UNBOUNDED}", upper=UNBOUNDED)
    for key in ("velocity", "effort"):
        limit.attrib.setdefault(key, UNBOUNDED)


def _chain(model: pin.Model) -> list[int]:
    chain: list[int] = []
    children = model.children[0]
    while len(children) == 1 and not FINGER.search(model.names[children[0]]):
        chain.append(int(children[0]))
        children = model.children[children[0]]
    return chain


def _belongs_to_hand(model: pin.Model, joint: int) -> bool:
    """Whether the joint or one below it is a finger."""
    return any(FINGER.search(model.names[ancestor]) for ancestor in model.supports[joint])


def _tip(model: pin.Model, joint: int) -> str:
    frames = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint == joint]
    for pattern in END_EFFECTOR:
        for name in frames:
            if pattern.search(name):
                return name
    return frames[0]
