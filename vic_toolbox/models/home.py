"""A rest posture for an arm whose description names none."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from vic_toolbox.errors import Array, ModelError

WELL_CONDITIONED = 0.02
"""Smallest singular value of J that a rest posture should have [metres and radians side by side]."""

SAMPLES = 256


def choose_home(model: pin.Model, frame: int, *, urdf: Path) -> Array:
    """Return a posture (nq,) [rad] within the limits and away from singularities.

    The first of the postures named beside the URDF, then zero, whose smallest singular value of J is large
    enough; if none is, the best conditioned of these and of some postures within ± 90 degrees.
    """
    data = model.createData()
    named = [*named_postures(urdf, list(model.names)[1:]), np.zeros(model.nq)]
    sampled = np.random.default_rng(0).uniform(-np.pi / 2, np.pi / 2, size=(SAMPLES, model.nq))
    candidates = np.clip([*named, *sampled], model.lowerPositionLimit, model.upperPositionLimit)
    jacobians = [pin.computeFrameJacobian(model, data, q, frame) for q in candidates]
    values = np.linalg.svd(np.array(jacobians), compute_uv=False)[:, -1]
    good = values[: len(named)] >= WELL_CONDITIONED
    return candidates[good.argmax() if good.any() else values.argmax()]


def named_postures(urdf: Path, joints: list[str]) -> list[Array]:
    """Postures that the semantic description beside a URDF (``../srdf/<name>.srdf``) names for these joints.

    Returns
    -------
    list of ndarray, shape (nq,)
        In the order of the file; empty without such a file.

    Raises
    ------
    ModelError
        The file is damaged.
    """
    path = urdf.parent.parent / "srdf" / f"{urdf.stem}.srdf"
    if not path.is_file():
        return []
    try:
        states = list(ElementTree.parse(path).getroot().iter("group_state"))
        named = [{j.get("name"): float(j.get("value", "nan")) for j in s.iter("joint")} for s in states]
    except (ElementTree.ParseError, ValueError) as error:
        raise ModelError(f"{path} is not an SRDF ({error}); correct it or remove it.") from error
    return [np.array([state[joint] for joint in joints]) for state in named if state.keys() >= set(joints)]
