"""Where MuJoCo's C structs keep their fields, for compiled functions that MuJoCo calls.

Such a function gets ``mjModel*`` and ``mjData*`` and must know at which byte a field lies. The layout is computed
from the description that MuJoCo ships (``mujoco.introspect``) by the rules of C, and compared with live objects
before anything is read through it: a MuJoCo that is laid out differently is refused, never misread.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterable, Mapping
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import ast_nodes, structs
from numba import types
from numba.extending import intrinsic

from vic_toolbox.errors import SimulationError

WORD = 8
"""Bytes of a pointer, of a ``mjtNum`` and of a ``mjtSize``."""

_C_TYPES: dict[str, Any] = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
}


def struct_offsets(struct: str, fields: Iterable[str]) -> dict[str, int]:
    """Byte offsets of fields of a MuJoCo C struct, laid out by the C rules from ``mujoco.introspect``.

    Parameters
    ----------
    struct : str
        ``"mjData"``, ``"mjModel"`` or another struct.
    fields : iterable of str
        Names of its members.

    Raises
    ------
    SimulationError
        This MuJoCo describes the struct with a type or a member that is not known here.
    """
    try:
        layout = _c_type(struct)
        return {field: getattr(layout, field).offset for field in fields}
    except (KeyError, AttributeError) as error:
        raise unknown_mujoco(f"the description of {struct} has changed: {error}") from error


def check_offsets(probe: str, *, data: Mapping[str, int], model: Mapping[str, int]) -> None:
    """Compare offsets with a live ``mjData`` and ``mjModel``: each must lead to what Python sees there.

    Parameters
    ----------
    probe : str
        MJCF of a small model in which no array among the fields is empty and no size is zero.
    data, model : mapping of str to int
        Field → byte offset in each struct. An array is compared by address, a size by value.

    Raises
    ------
    SimulationError
        An offset does not lead to its field. Nothing may be read through it then.
    """
    live_model = mujoco.MjModel.from_xml_string(probe)
    live_data = mujoco.MjData(live_model)
    mujoco.mj_forward(live_model, live_data)
    for struct, live, offsets in (("mjData", live_data, data), ("mjModel", live_model, model)):
        for field, offset in offsets.items():
            seen = getattr(live, field)
            if isinstance(seen, np.ndarray):
                seen = seen.__array_interface__["data"][0]
            if ctypes.c_uint64.from_address(live._address + offset).value != seen:
                raise unknown_mujoco(f"{struct}.{field} is not at byte {offset}")


def unknown_mujoco(what: str) -> SimulationError:
    """Error for a MuJoCo that is not laid out as this toolbox knows it; ``what`` names the difference."""
    return SimulationError(
        f"vic_toolbox does not know the memory layout of MuJoCo {mujoco.__version__} ({what}). "
        "Install one that it knows: pip install 'mujoco==4.0.*'."
    )


@functools.cache
def _c_type(name: str) -> Any:
    """Ctypes counterpart of a C type name; structs are built from their description."""
    return _C_TYPES[name] if name in _C_TYPES else _c_struct(name, structs.STRUCTS[name].fields)


def _c_struct(name: str, fields: Any) -> Any:
    return type(
        name, (ctypes.Structure,), {"_fields_": [(field.name, _c_member(field.type)) for field in fields]}
    )


def _c_member(declared: Any) -> Any:
    if isinstance(declared, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(declared, ast_nodes.ArrayType):
        return functools.reduce(
            lambda inner, n: inner * n, reversed(declared.extents), _c_member(declared.inner_type)
        )
    if isinstance(declared, ast_nodes.AnonymousStructDecl):
        return _c_struct("anonymous", declared.fields)
    return _c_type(declared.name)


def _float_pointer(typingctx, address):  # type: ignore[no-untyped-def]
    """A uint64 address as a pointer to float64."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.uint64), generate


pointer: Any = intrinsic(_float_pointer)
"""``pointer(address)``: a uint64 address as a pointer to float64, in compiled code."""
