"""The round, chamfered hole as a geom of MuJoCo, whose contacts with a cylinder are exact.

MuJoCo knows no concave round shape; a hole of convex wedges is a polygon, and its corners decide whether a tight peg
goes in. So the hole is a geom of a type whose pair with a cylinder may hold many contacts, a 2 × 2 height field, with
its measures in ``geom_user`` behind a *tag*, and the entry of MuJoCo's table of collision functions
(``mjCOLLISIONFUNC``) for height field against cylinder is a compiled function that

- for a tagged height field calls :func:`vic_toolbox.tasks.bore_contacts.contacts`;
- for every other one calls MuJoCo's own function: models without such a hole do not change.

The table is global to the process. Without the function in it a hole is a flat plate, so whoever simulates one calls
:func:`install` first and makes sure that it is still :func:`installed`.
"""

from __future__ import annotations

import ctypes
import functools
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numba import carray, cfunc, njit, types

from vic_toolbox.errors import InputError, SimulationError, positive
from vic_toolbox.tasks import bore_contacts
from vic_toolbox.tasks.mujoco_structs import WORD, check_offsets, pointer, struct_offsets, unknown_mujoco

TAG = float(int.from_bytes(b"VICBOR", "big"))
"""First number of ``geom_user`` of a hole; radius, chamfer, depth [m] and 1 for a blind hole follow."""

USER_SIZE = 5
"""Numbers in ``geom_user`` that a hole needs."""

_DATA_FIELDS = ("geom_xpos", "geom_xmat")
_MODEL_FIELDS = ("nuser_geom", "geom_user", "geom_size")
_CONTACT_SIZE = 10  # float64 in an mjPreContact: distance, position, normal, tangent

_HFIELD, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_CAPSULE, _BOX = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_BOX)
_TYPES = int(mujoco.mjtGeom.mjNGEOMTYPES)

_WORDS, _NUMBERS = types.CPointer(types.uint64), types.CPointer(types.float64)
_SIGNATURE = types.int32(_WORDS, _WORDS, _NUMBERS, types.int32, types.int32, types.float64)
_Words, _Numbers = ctypes.POINTER(ctypes.c_uint64), ctypes.POINTER(ctypes.c_double)
_Collide = ctypes.CFUNCTYPE(
    ctypes.c_int, _Words, _Words, _Numbers, ctypes.c_int, ctypes.c_int, ctypes.c_double
)

_lock = threading.Lock()
_compiled: set[int] = set()  # addresses of the compiled collision function


def add_hole(
    spec: mujoco.MjSpec,
    name: str,
    *,
    radius: float,
    chamfer: float,
    depth: float,
    half_width: float,
    closed: bool = False,
    **geom: Any,
) -> Any:
    """Add a plate with a round, chamfered hole to the world; only cylinders feel the hole.

    The hole's axis is the geom's z, its mouth the geom's plane z = 0.

    Parameters
    ----------
    spec : mujoco.MjSpec
    name : str
        Name of the geom and of its height-field asset.
    radius, chamfer, depth : float
        Radius of the bore, width and depth of its 45° chamfer, and depth of the bore from the mouth [m].
    half_width : float
        Half the side of the square plate [m]. Beyond it nothing is touched.
    closed : bool
        Whether the hole has a bottom at its depth; otherwise it goes through, and nothing is touched below.
    **geom
        Attributes of MuJoCo's geom: ``pos``, ``friction``, ``contype``, ...

    Returns
    -------
    mujoco.MjsGeom

    Raises
    ------
    InputError
        A length is not positive, the chamfer is as deep as the hole, the mouth is as wide as the plate, ``geom``
        sets what the hole itself sets, or the spec fixes ``nuser_geom`` below five.
    """
    radius, chamfer, depth = (
        positive("radius", radius),
        positive("chamfer", chamfer),
        positive("depth", depth),
    )
    half_width = positive("half_width", half_width)
    if chamfer >= depth:
        raise InputError(
            f"chamfer is {chamfer:g} m and depth {depth:g} m; make the hole deeper than its chamfer."
        )
    if half_width <= radius + chamfer:
        raise InputError(
            f"half_width is {half_width:g} m, but the mouth has the radius {radius + chamfer:g} m (radius + chamfer); "
            "make the plate wider."
        )
    if own := {"type", "hfieldname", "userdata", "size"} & geom.keys():
        raise InputError(f"{', '.join(sorted(own))}: add_hole sets this itself; leave it out.")
    if 0 <= spec.nuser_geom < USER_SIZE:
        raise InputError(
            f"the spec fixes nuser_geom = {spec.nuser_geom}; set it to -1 (automatic) or to at least {USER_SIZE}."
        )
    thin = 1e-6 * depth  # MuJoCo wants a positive elevation
    spec.add_hfield(name=name, nrow=2, ncol=2, size=[half_width, half_width, thin, depth], userdata=[0.0] * 4)
    return spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname=name,
        userdata=[TAG, radius, chamfer, depth, float(closed)],
        **geom,
    )


def install() -> None:
    """Make holes round in this process. Calling it again costs nothing.

    The first call compiles (seconds on a new machine, less than one later), and compares the contacts of a probe
    in MuJoCo with the collider's own.

    Raises
    ------
    SimulationError
        Another program part has put its own function into the table, or this MuJoCo is not laid out or does not
        behave as the collider expects. The table is then as it was.
    """
    with _lock:
        if installed():
            return
        table = _table()
        mujocos_own = _mujocos_own(table)
        table[_CYLINDER] = collide = _compile(mujocos_own).address
        _compiled.add(collide)
        try:
            _check_probe()
        except SimulationError:
            table[_CYLINDER] = mujocos_own
            raise


def uninstall() -> None:
    """Give the pair of height field and cylinder back to MuJoCo; :func:`install` makes holes round again.

    Raises
    ------
    SimulationError
        Another program part has put its own function into the table.
    """
    with _lock:
        table = _table()
        if installed():
            table[_CYLINDER] = table[_BOX]
        _mujocos_own(table)


def installed() -> bool:
    """Whether holes are round at this moment."""
    return bool(_compiled) and _table()[_CYLINDER] in _compiled


_PROBE = f"""
<mujoco><asset><hfield name="hole" nrow="2" ncol="2" size=".03 .03 1e-6 .02" elevation="0 0 0 0"/></asset>
  <worldbody><geom type="hfield" hfield="hole" margin="1e-3" user="{TAG:.17g} .0127 .0005 .02 0"/>
    <body pos="2e-5 1e-5 .03" euler=".02 .01 0"><freejoint/><geom type="cylinder" size=".0126 .04"/></body>
  </worldbody>
</mujoco>"""


@functools.cache
def _table() -> Any:
    """MuJoCo's collision functions of a height field with each type of geom, as addresses; live."""
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll")  # Linux, macOS, Windows
    for path in (path for name in names for path in sorted(folder.glob(name))):
        rows = (ctypes.c_void_p * _TYPES) * _TYPES
        return rows.in_dll(ctypes.CDLL(str(path)), "mjCOLLISIONFUNC")[_HFIELD]
    raise unknown_mujoco(f"no library {' or '.join(names)} in {folder}")


def _mujocos_own(table: Any) -> int:
    """MuJoCo's function for a height field and a cylinder, which is that for every other convex geom too.

    Raises
    ------
    SimulationError
        Another function is there.
    """
    if table[_CAPSULE] != table[_BOX] or table[_BOX] is None:
        raise unknown_mujoco("height fields do not have one collision function for all convex geoms")
    if table[_CYLINDER] != table[_BOX]:
        raise SimulationError(
            "MuJoCo's collision function of height fields and cylinders has been replaced by another program part, "
            "so holes cannot be round. Make it put MuJoCo's own function back into mjCOLLISIONFUNC first."
        )
    return table[_BOX]


def _check_probe() -> None:
    """Compare the contacts that MuJoCo finds in the probe with those that it should find there."""
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = np.zeros((bore_contacts.MAX_CONTACTS, _CONTACT_SIZE))
    axis = data.geom_xmat[1, 2::3]
    peg, hole = tuple(model.geom_size[1, :2]), tuple(model.geom_user[0, 1:])
    count = bore_contacts.contacts(
        rows, tuple(data.geom_xpos[1]), tuple(axis), peg, hole, model.geom_margin[0]
    )
    if data.ncon != count or not np.allclose(data.contact.dist, rows[:count, 0], rtol=0.0, atol=1e-12):
        raise unknown_mujoco(
            f"it finds {data.ncon} contacts of a probe where the collider finds {count}, or others"
        )


@functools.cache
def _compile(mujocos_own: int) -> Any:
    """The collision function ``(mjModel*, mjData*, mjPreContact*, hfield, cylinder, margin) -> count``.

    Pairs that are no hole go to the function at the address ``mujocos_own``.
    """
    data_offsets = struct_offsets("mjData", _DATA_FIELDS)
    model_offsets = struct_offsets("mjModel", _MODEL_FIELDS)
    check_offsets(_PROBE, data=data_offsets, model=model_offsets)
    contact = struct_offsets("mjPreContact", ("dist", "pos", "normal", "tangent"))
    if list(contact.values()) != [0, WORD, 4 * WORD, 7 * WORD]:
        raise unknown_mujoco(f"mjPreContact is laid out as {contact}")
    positions, rotations = (data_offsets[field] // WORD for field in _DATA_FIELDS)
    user_size, users, sizes = (model_offsets[field] // WORD for field in _MODEL_FIELDS)
    data_words, model_words = (max(offsets.values()) // WORD + 1 for offsets in (data_offsets, model_offsets))
    tag, least, room, width = TAG, USER_SIZE, bore_contacts.MAX_CONTACTS, _CONTACT_SIZE
    other, find, relative, to_world = _Collide(mujocos_own), bore_contacts.contacts, _relative_pose, _to_world

    @cfunc(_SIGNATURE, error_model="numpy")
    def collide(model, data, found, hole, peg, margin):  # type: ignore[no-untyped-def]
        models, datas = carray(model, (model_words,)), carray(data, (data_words,))
        geoms, numbers = max(hole, peg) + 1, int(models[user_size])
        if numbers < least:
            return other(model, data, found, hole, peg, margin)
        user = carray(pointer(models[users]), (geoms, numbers))[hole]
        if user[0] != tag:
            return other(model, data, found, hole, peg, margin)
        size = carray(pointer(models[sizes]), (geoms, 3))[peg]
        position = carray(pointer(datas[positions]), (geoms, 3))
        rotation = carray(pointer(datas[rotations]), (geoms, 3, 3))
        center, axis = relative(position[hole], rotation[hole], position[peg], rotation[peg])
        rows = carray(found, (room, width))
        count = find(rows, center, axis, (size[0], size[1]), (user[1], user[2], user[3], user[4]), margin)
        to_world(rows, count, position[hole], rotation[hole])
        return count

    return collide


@njit(error_model="numpy")
def _relative_pose(hole_position, hole_rotation, position, rotation):
    """Position and z-axis of a geom in the hole's frame."""
    x = position[0] - hole_position[0]
    y = position[1] - hole_position[1]
    z = position[2] - hole_position[2]
    return _turned_back(hole_rotation, x, y, z), _turned_back(
        hole_rotation, rotation[0, 2], rotation[1, 2], rotation[2, 2]
    )


@njit(error_model="numpy")
def _turned_back(r, x, y, z):
    """Rᵀ times a vector."""
    return (
        r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
        r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
        r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
    )


@njit(error_model="numpy")
def _to_world(rows, count, position, r):
    """Turn contacts from the hole's frame to the world's; MuJoCo chooses tangents that are zero."""
    for i in range(count):
        x, y, z, u, v, w = rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5], rows[i, 6]
        for k in range(3):
            rows[i, 1 + k] = position[k] + r[k, 0] * x + r[k, 1] * y + r[k, 2] * z
            rows[i, 4 + k] = r[k, 0] * u + r[k, 1] * v + r[k, 2] * w
            rows[i, 7 + k] = 0.0
