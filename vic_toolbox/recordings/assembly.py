"""From named columns and a layout to a recording in SI units and world axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vic_toolbox.errors import Array, FileError, InputError
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.guessing import guess_columns
from vic_toolbox.recordings.layout import ORIENTATIONS, Layout, listed, nearest, resolve
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.table import Table
from vic_toolbox.recordings.transport import IDENTITY, wrench_to_world


def assemble(table: Table, layout: Layout) -> Recording:
    """Build the recording that a table holds.

    Parameters
    ----------
    table : Table
    layout : Layout
        Wins over what is guessed.

    Raises
    ------
    InputError
        A column that the layout names, or one that no recording can do without, is not there.
    """
    columns, notes = _chosen(table, layout)
    wanted = list(dict.fromkeys(name for names in columns.values() for name in names))
    loaded = table.load(wanted)
    values = {name: np.column_stack([loaded[c] for c in names]) for name, names in columns.items()}
    for name in values:
        values[name] = values[name] * _factors(name, values[name].shape[1], layout)
    count = len(next(iter(values.values())))
    fields = _pose(values, layout, notes, count)
    wrench = layout.wrench_sign * values["wrench"]
    if wrench.shape[1] == 3:
        notes.append("no moment in the log: it is zero here, and the rotational gains cannot be fitted")
        wrench = np.hstack([wrench, np.zeros((count, 3))])
    time = values["time"][:, 0] if "time" in values else np.arange(count) / (layout.rate or 1.0)
    optional = ("joint_position", "joint_velocity", "stiffness", "damping", "twist", "reference_twist")
    recording = Recording(
        time=time,
        wrench=wrench,
        **fields,
        **{name: values[name] for name in optional if name in values},
        wrench_axes=layout.wrench_axes,
        source=table.source,
        notes=tuple(notes),
    )
    if layout.wrench_axes == "world" and layout.sensor_rotation == IDENTITY and not any(layout.sensor_offset):
        return recording
    return wrench_to_world(recording, rotation=layout.sensor_rotation, offset=layout.sensor_offset)


def _chosen(table: Table, layout: Layout) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Columns of each field, and what was guessed."""
    guessed = dict(table.fields) or guess_columns(table.names)
    for name in layout.columns:  # an orientation that is stated rules out one that is guessed
        for prefix in ("", "reference_"):
            if name in {f"{prefix}{kind}" for kind in ORIENTATIONS}:
                guessed = {
                    k: v for k, v in guessed.items() if k not in {f"{prefix}{o}" for o in ORIENTATIONS}
                }
    if layout.reference != "logged":
        guessed = {k: v for k, v in guessed.items() if not k.startswith("reference_")}
    try:
        stated = {name: resolve(wanted, table.names, name) for name, wanted in layout.columns.items()}
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from error
    if layout.rate is not None and "time" not in stated:
        guessed.pop("time", None)
    columns = guessed | stated
    notes = list(table.notes)
    notes += [
        f"guessed {n} = {', '.join(c)}"
        for n, c in guessed.items()
        if n not in stated and n not in table.fields
    ]
    needed = ["wrench", "position"] + ["time"] * (layout.rate is None)
    needed += ["reference_position"] * (layout.reference == "logged")
    for name in needed:
        if name not in columns:
            raise InputError(f"{table.source}: no column was recognised as {name}; {_remedy(name, table)}")
    return columns, notes


def _remedy(name: str, table: Table) -> str:
    advice = {
        "time": "name it in the layout, or state the rate",
        "reference_position": "name it in the layout, or choose reference 'start' or 'mean' for one that stands still",
    }.get(name, "name it in the layout")
    return f"{advice} ([columns] {name} = ...); {nearest(name, table.names)}"


def _factors(name: str, width: int, layout: Layout) -> Array:
    """What brings the columns of a field into SI units."""
    base = name.removeprefix("reference_")
    length, angle = layout.factor("length"), layout.factor("angle")
    force, moment = layout.factor("force"), layout.factor("moment")
    by_field: Mapping[str, list[float]] = {
        "time": [layout.factor("time")],
        "position": [length] * 3,
        "axis_angle": [1.0, 1.0, 1.0, angle],
        "rotation_vector": [angle] * 3,
        "roll_pitch_yaw": [angle] * 3,
        "wrench": ([force] * 3 + [moment] * 3)[:width],
        "twist": [length] * 3 + [angle] * 3,
    }
    if base in ("joint_position", "joint_velocity"):
        return np.full(width, angle)
    return np.array(by_field.get(base, [1.0] * width))


def _pose(values: dict[str, Array], layout: Layout, notes: list[str], count: int) -> dict[str, Array]:
    """Pose and reference; what is missing is chosen so that it adds nothing to the error."""
    position, quat = values["position"], _quaternion(values, "", notes)
    if quat is None:
        notes.append(
            "no orientation in the log: it is the identity here, and the rotational gains cannot be fitted"
        )
        quat = np.tile(quaternions.IDENTITY, (count, 1))
    if layout.reference == "logged":
        reference, reference_quat = values["reference_position"], _quaternion(values, "reference_", notes)
        if reference_quat is None:
            notes.append("no reference orientation in the log: the rotational error is zero here")
            reference_quat = quat
    else:
        notes.append(f"reference: stands still, {layout.reference} of the pose")
        rows = slice(0, 1) if layout.reference == "start" else slice(None)
        reference = np.tile(position[rows].mean(axis=0), (count, 1))
        track = quaternions.continuous(quat)[rows].mean(axis=0, keepdims=True)
        reference_quat = np.tile(quaternions.normalised(track), (count, 1))
    return {
        "position": position,
        "quat_wxyz": quat,
        "reference_position": reference,
        "reference_quat_wxyz": reference_quat,
    }


def _quaternion(values: dict[str, Array], prefix: str, notes: list[str]) -> Array | None:
    kind = next((kind for kind in ORIENTATIONS if f"{prefix}{kind}" in values), None)
    if kind is None:
        return None
    given = values[f"{prefix}{kind}"]
    if kind == "quat_wxyz":
        return given
    if kind == "quat_xyzw":
        return given[:, [3, 0, 1, 2]]
    if kind == "rotation_vector":
        return quaternions.exp(given)
    if kind == "roll_pitch_yaw":
        turns = [quaternions.exp(given[:, [i]] * np.eye(3)[i]) for i in range(3)]
        return quaternions.multiply(turns[2], quaternions.multiply(turns[1], turns[0]))
    norm = np.linalg.norm(given[:, :3], axis=1, keepdims=True)
    if (off := np.abs(norm - 1) > 0.01).any():
        notes.append(
            f"the axis of {prefix}axis_angle is no unit vector in {off.sum()} samples "
            f"(norm {norm[off.argmax(), 0]:.3g} in sample {off.argmax()}): only its direction is used"
        )
    return quaternions.exp(given[:, 3:] * given[:, :3] / np.where(norm == 0, 1.0, norm))


def native_recording(source: str, arrays: dict[str, Array], text: dict[str, object]) -> Recording:
    """A recording from the arrays and texts of a file that :meth:`Recording.save` wrote."""
    from vic_toolbox.recordings.recording import SHAPES

    unknown = arrays.keys() - SHAPES.keys()
    missing = set(list(SHAPES)[:6]) - arrays.keys()
    if unknown or missing:
        raise FileError(
            f"{source} is a damaged recording (unknown: {listed(sorted(unknown))}; "
            f"missing: {listed(sorted(missing))})."
        )
    notes = str(text.get("notes", ""))
    try:
        return Recording(
            **arrays,
            wrench_axes=str(text.get("wrench_axes", "world")),
            source=source,
            notes=tuple(notes.split("\n")) if notes else (),
        )
    except InputError as error:
        raise FileError(f"{source} is a damaged recording ({error})") from error
