"""Mending a recording, only when asked; what was done is in its notes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import InputError, one_of
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.validation import meaningful
from vic_toolbox.spatial import QUATERNION_TOLERANCE

if TYPE_CHECKING:
    from vic_toolbox.recordings.recording import Recording


def repair(recording: Recording, kinds: Sequence[str] | None = None) -> Recording:
    """Mend what can be mended without guessing, and note it.

    ========== ==================================================================================
    time       drop samples that are not later than all before them
    duplicate  drop samples with the time, or with the pose and wrench, of the one before
    nan        drop samples with a number that is not finite
    quaternion divide quaternions by their norm; drop those of zeros
    flip       choose the signs of the quaternions so that they do not jump
    ========== ==================================================================================

    Parameters
    ----------
    recording : Recording
    kinds : sequence of str, optional
        What to mend; by default everything of the table.

    Returns
    -------
    Recording
        With a line in ``notes`` for each repair that changed something.

    Raises
    ------
    InputError
        Unknown kind, or no sample is left.
    """
    for kind in REPAIRS if kinds is None else [one_of("kind", kind, REPAIRS) for kind in kinds]:
        recording = REPAIRS[kind](recording)
    return recording


def _keep(recording: Recording, keep: NDArray[np.bool_], why: str) -> Recording:
    if keep.all():
        return recording
    if not keep.any():
        raise InputError(f"no sample is left after dropping {why}; check the columns of the log.")
    rows = {name: array[keep] for name, array in recording.arrays().items()}
    note = f"dropped {np.count_nonzero(~keep)} samples: {why}"
    return dataclasses.replace(recording, **rows, notes=(*recording.notes, note))


def _drop_not_finite(recording: Recording) -> Recording:
    keep = np.ones(len(recording), dtype=bool)
    for array in recording.arrays().values():
        keep &= meaningful(array)
    return _keep(recording, keep, "not finite")


def _drop_late(recording: Recording) -> Recording:
    latest = np.fmax.accumulate(recording.time)
    keep = np.concatenate([[True], ~(recording.time[1:] < latest[:-1])])
    return _keep(recording, keep, "time ran backwards")


def _drop_duplicates(recording: Recording) -> Recording:
    measured = np.hstack([recording.position, recording.quat_wxyz, recording.wrench])
    same = (measured[1:] == measured[:-1]).all(axis=1)
    if same.all():  # a log that stands still throughout has nothing to drop
        same = np.zeros_like(same)
    keep = np.concatenate([[True], ~same & (recording.time[1:] != recording.time[:-1])])
    return _keep(recording, keep, "the same as the sample before")


def _normalise(recording: Recording) -> Recording:
    changed = {}
    keep = np.ones(len(recording), dtype=bool)
    for name in ("quat_wxyz", "reference_quat_wxyz"):
        norm = np.linalg.norm(getattr(recording, name), axis=1)
        keep &= norm > 0
        if (np.abs(norm - 1) > QUATERNION_TOLERANCE).any():
            changed[name] = quaternions.normalised(getattr(recording, name))
    if changed:
        notes = (*recording.notes, f"normalised {' and '.join(changed)}")
        recording = dataclasses.replace(recording, **changed, notes=notes)
    return _keep(recording, keep, "quaternions of zeros")


def _unflip(recording: Recording) -> Recording:
    names = ("quat_wxyz", "reference_quat_wxyz")
    tracks = {name: getattr(recording, name) for name in names}
    changed = {
        name: quaternions.continuous(q) for name, q in tracks.items() if len(quaternions.sign_flips(q))
    }
    if not changed:
        return recording
    notes = (*recording.notes, f"removed sign flips of {' and '.join(changed)}")
    return dataclasses.replace(recording, **changed, notes=notes)


REPAIRS = {
    "nan": _drop_not_finite,
    "time": _drop_late,
    "duplicate": _drop_duplicates,
    "quaternion": _normalise,
    "flip": _unflip,
}
