"""What is kept of a subject: the axes that are asked for and can be judged, and the time in which they can."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vic_toolbox.errors import Array, InputError, one_of
from vic_toolbox.stability.analysis.determined import determined, refuse_negative
from vic_toolbox.stability.analysis.setting import Setting, listed
from vic_toolbox.stability.analysis.subject import Constant, Course, GainRange


def kept(
    read: Course | GainRange | Constant, setting: Setting, axes: Sequence[str] | None
) -> tuple[Course | GainRange | Constant, Setting, list[str]]:
    """The axes that are asked for, have a mass and are determined, and the stretch of time in which they are."""
    names, inertia, notes = setting.names, setting.inertia, []
    wanted = list(range(len(names)))
    if axes is not None:
        for name in axes:
            one_of("axis", name, names)
        wanted = [i for i, name in enumerate(names) if name in axes]
        if rest := [name for name in names if name not in axes]:
            notes.append(f"{listed(rest)} left out as asked, as if they stood still")
    wanted = [i for i in wanted if i not in inertia.dropped]
    if not wanted:
        raise InputError(
            "no axis is left to judge: the mass says nothing about those asked for; pass six masses."
        )
    window = slice(None)
    if isinstance(read, Constant):
        course = Course(np.zeros(1), read.stiffness[None], read.damping[None])
        wanted, _, more = determined(course, wanted, names)
        notes += more
    if isinstance(read, Course):
        wanted, window, more = determined(read, wanted, names)
        notes += more
    index = np.array(wanted)
    mass = inertia.mass
    if mass is not None:
        mass = (mass[window] if mass.ndim == 3 else mass)[..., index[:, None], index]
    ways = {
        name: a[window] if a is not None and a.ndim == 2 else a
        for name, a in (("q", inertia.q), ("v", inertia.v))
    }
    setting = replace(
        setting,
        names=tuple(names[i] for i in wanted),
        inertia=inertia._replace(mass=mass, **ways),
        physical_damping=setting.physical_damping[index[:, None], index],
    )
    read = _reduced(read, index, window)
    refuse_negative(
        *gains_that_occur(read), setting.names, None if not isinstance(read, Course) else read.time
    )
    return read, setting, notes


def _reduced(
    read: Course | GainRange | Constant, axes: np.ndarray, window: slice
) -> Course | GainRange | Constant:
    def part(a: Array) -> Array:
        return a[..., axes[:, None], axes]

    if isinstance(read, Constant):
        return Constant(part(read.stiffness), part(read.damping))
    if isinstance(read, GainRange):
        cover = None if read.cover is None else (part(read.cover[0]), part(read.cover[1]))
        members = part(read.members[0]), part(read.members[1])
        return read._replace(members=members, cover=members if read.cover is read.members else cover)
    motion = [None if a is None else a[window][:, axes] for a in (read.error, read.error_rate)]
    return Course(read.time[window], part(read.stiffness[window]), part(read.damping[window]), *motion)


def gains_that_occur(read: Course | GainRange | Constant) -> tuple[Array, Array]:
    """All gains that occur (n, d, d)."""
    if isinstance(read, GainRange):
        return read.members
    if isinstance(read, Constant):
        return read.stiffness[None], read.damping[None]
    return read.stiffness, read.damping
