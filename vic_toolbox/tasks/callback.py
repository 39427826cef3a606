"""The compiled impedance law as MuJoCo's control callback.

MuJoCo calls ``mjcb_control(model, data)`` at every physics step, after positions, velocities and the bias
torque are known. The callback here reads them straight from the C structs, calls
:func:`vic_toolbox.control.compiled.compile_law` and writes ``ctrl``; Python is never entered, so a batch of
simulations runs on all threads.

``mjcb_control`` is global to the process. The callback therefore acts only on *its own* models, which it
knows by their number of ``userdata`` entries and by the law block's magic number there; on every other model
it does nothing.

The models it serves are built by :mod:`vic_toolbox.tasks.scene`, and keep this contract:

- the arm's joints are the first of the model and form one serial chain;
- site 0 is the end-effector, motor ``i`` drives joint ``i``;
- the first sensor, if there is one, measures the net contact force on the held object (``found``, ``force``,
  ``torque``);
- ``userdata`` is the law block, then :data:`EXTRA_FIELDS`.
"""

from __future__ import annotations

import ctypes
import math
import threading
from types import MappingProxyType
from typing import Any

import mujoco
from numba import carray, cfunc, types

from vic_toolbox.control.compiled import LAW_FIELDS, LAW_MAGIC, compile_law, law_block_size
from vic_toolbox.errors import SimulationError
from vic_toolbox.tasks.mujoco_structs import WORD, check_offsets, pointer, struct_offsets

EXTRA_FIELDS = MappingProxyType({"ticks": 0, "peak_force": 1})
"""Name → place after the law block.

``ticks`` counts the physics steps since it was set to zero; ``peak_force`` [N] is the largest contact force
on the held object over the steps that the callback has seen finished since then. A batch loads another
simulation into the same ``mjData`` between calls, so the sensor is read from the second tick on; the last
step's force is the sensor's output.
"""

DATA_FIELDS = (
    "qpos", "qvel", "ctrl", "userdata", "sensordata",
    "xaxis", "xanchor", "site_xpos", "site_xmat", "qfrc_bias", "M",
)  # fmt: skip
"""Arrays of ``mjData`` that the callback reads or writes, by their C names."""

MODEL_FIELDS = ("nuserdata", "nsensordata")
"""Sizes of ``mjModel`` that it reads."""

_lock = threading.Lock()
_installed: dict[int, Any] = {}  # number of joints → callback; each one calls the one installed before it


def userdata_size(nv: int) -> int:
    """Length of ``userdata`` of a model whose arm has ``nv`` joints."""
    return law_block_size(nv) + len(EXTRA_FIELDS)


PROBE = f"""
<mujoco><size nuserdata="{userdata_size(6)}"/>
  <worldbody><body><joint name="hinge"/><geom size=".1"/><site name="tip"/></body></worldbody>
  <actuator><motor joint="hinge"/></actuator><sensor><jointpos joint="hinge"/></sensor>
</mujoco>"""


def install(nv: int) -> None:
    """Make the impedance law run in every model of an ``nv``-joint arm, for the whole process.

    Calling it again costs nothing: a simulation does so when it is made and at each reset.

    Raises
    ------
    SimulationError
        Another program part has installed its own ``mjcb_control``, or this MuJoCo's memory layout is not
        known.
    """
    with _lock:
        _refuse_foreign_callback()
        if nv not in _installed:
            callback = _compile(nv, previous=next(reversed(_installed.values()), None))
            mujoco.set_mjcb_control(callback.ctypes)
            _installed[nv] = callback
        elif mujoco.get_mjcb_control() is None:
            mujoco.set_mjcb_control(next(reversed(_installed.values())).ctypes)


def uninstall() -> None:
    """Take the law out of MuJoCo; :func:`install` puts it back."""
    with _lock:
        _refuse_foreign_callback()
        mujoco.set_mjcb_control(None)


def _refuse_foreign_callback() -> None:
    current = mujoco.get_mjcb_control()
    ours = {ctypes.cast(callback.ctypes, ctypes.c_void_p).value for callback in _installed.values()}
    if current is None or _address(current) in ours:
        return
    raise SimulationError(
        f"mjcb_control is taken by {current!r}, so the impedance law cannot run. "
        "Remove it with mujoco.set_mjcb_control(None) before you make or reset a task."
    )


def _address(callback: Any) -> int | None:
    try:
        return ctypes.cast(callback, ctypes.c_void_p).value
    except (TypeError, ctypes.ArgumentError):
        return None


def _compile(nv: int, *, previous: Any) -> Any:
    """Control callback of arms with ``nv`` joints; other models go to ``previous``."""
    data_offsets = struct_offsets("mjData", DATA_FIELDS)
    model_offsets = struct_offsets("mjModel", MODEL_FIELDS)
    check_offsets(PROBE, data=data_offsets, model=model_offsets)
    qpos, qvel, ctrl, userdata, sensordata, axis, anchor, position, rotation, bias, mass = (
        data_offsets[field] // WORD for field in DATA_FIELDS
    )
    own_size, sensor_size = (model_offsets[field] // WORD for field in MODEL_FIELDS)
    data_words, model_words = (max(offsets.values()) // WORD + 1 for offsets in (data_offsets, model_offsets))
    size = userdata_size(nv)
    magic = LAW_FIELDS["magic"].start
    ticks, peak = (law_block_size(nv) + EXTRA_FIELDS[name] for name in ("ticks", "peak_force"))
    law, magic_number, packed = compile_law(nv), LAW_MAGIC, nv * (nv + 1) // 2
    other = None if previous is None else previous.ctypes

    @cfunc(types.void(types.CPointer(types.uint64), types.CPointer(types.uint64)), error_model="numpy")
    def control(model, data):  # type: ignore[no-untyped-def]
        word, sizes = carray(data, (data_words,)), carray(model, (model_words,))
        block = carray(pointer(word[userdata]), (size,))
        if sizes[own_size] != size or block[magic] != magic_number:
            if other is not None:
                other(model, data)
            return
        law(
            block,
            carray(pointer(word[qpos]), (nv,)),
            carray(pointer(word[qvel]), (nv,)),
            carray(pointer(word[axis]), (nv, 3)),
            carray(pointer(word[anchor]), (nv, 3)),
            carray(pointer(word[position]), (3,)),
            carray(pointer(word[rotation]), (9,)),
            carray(pointer(word[bias]), (nv,)),
            carray(pointer(word[mass]), (packed,)),
            carray(pointer(word[ctrl]), (nv,)),
        )
        if block[ticks] > 0.0 and sizes[sensor_size] >= 4:
            sensor = carray(pointer(word[sensordata]), (4,))
            force = math.sqrt(sensor[1] * sensor[1] + sensor[2] * sensor[2] + sensor[3] * sensor[3])
            if force > block[peak]:
                block[peak] = force
        block[ticks] += 1.0

    return control
