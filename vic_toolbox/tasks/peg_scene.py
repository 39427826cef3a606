"""The scene of Peg-in-Hole: a free round peg above a round, chamfered hole, and the variants of it.

World axes: the hole's axis is z, its mouth (the block's top) is z = 0. The impedance law is native: six
actuators between the peg's centre of mass and the goal, which MuJoCo integrates implicitly with the contacts.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import mujoco

from vic_toolbox.errors import InputError, ModelError, finite_number, one_of
from vic_toolbox.models.catalogue import find_robot
from vic_toolbox.tasks import collider, wedges

HOLE_RADIUS = 12.70e-3
"""[m], at scale 1; the peg is narrower by the clearance."""
CHAMFER = 0.4e-3
"""Width and depth of the 45° chamfer at the hole's mouth [m]."""
BORE_DEPTH = 25e-3
"""[m]"""
GOAL_DEPTH = 10e-3
"""How deep below the mouth the tip should come [m]."""
BLOCK = 30e-3
"""Half the width of the block [m]."""
TIP_DISTANCE = 60e-3
"""From the peg's centre of mass to its tip [m]."""

TIMESTEP = 1e-3
"""Period of the physics [s]."""

DAMPING = (60.0, 60.0, 900.0, 1.8, 1.8, 1.8)
"""Fixed damping of the law [Ns/m, Nms/rad]; with the scale of the part it does not change."""

SOLREF, SOLIMP = (0.002, 1.0), (0.999, 0.9999, 1e-5, 0.5, 2.0)
"""Hard contacts: MuJoCo's own would give way by more than twenty times the clearance."""

_BLOCK, _PEG = 1, 2  # collision classes


@dataclass(frozen=True)
class PegScenario:
    """One variant of Peg-in-Hole. Lengths are those at scale 1: peg, hole and start scale together."""

    tilt: float = -2.0
    """Angle of the peg about y at the start [deg]."""
    scale: float = 1.0
    """Size of peg and hole; gains, mass and damping stay."""
    offset: float = 0.0
    """Distance of the tip from the hole's axis at the start, along x [mm]."""
    friction: float = 0.25
    """Coefficient of friction; the default is dry metal."""
    clearance: float = 15.0
    """Radius of the hole less that of the peg [µm]."""

    def __post_init__(self) -> None:
        for field in fields(self):
            low, high = LIMITS[field.name]
            value = finite_number(field.name, getattr(self, field.name))
            if not low <= value <= high:
                received = f"{value:g} {UNITS[field.name]}".strip()
                raise InputError(
                    f"{field.name} is {received}; it must be within [{low:g}, {high:g}]{WHY[field.name]}."
                )
            object.__setattr__(self, field.name, value)

    @property
    def name(self) -> str:
        """What differs from the training scenario, e.g. ``tilt=-6,scale=0.5``; without a difference ``train``."""
        changed = (
            f"{field.name}={getattr(self, field.name)!r}".removesuffix(".0")
            for field in fields(self)
            if getattr(self, field.name) != field.default
        )
        return ",".join(changed) or "train"

    @property
    def description(self) -> str:
        """The same in words."""
        changed = (field.name for field in fields(self) if getattr(self, field.name) != field.default)
        shown = ("tilt", "scale") if self.name == "train" else changed
        words = (f"{name} {getattr(self, name):g} {UNITS[name]}".strip() for name in shown)
        return ", ".join(words).replace("-", "−")

    @property
    def geometry(self) -> tuple[float, float, float]:
        """What the physics model depends on: scale, friction and clearance."""
        return self.scale, self.friction, self.clearance


UNITS = MappingProxyType({"tilt": "deg", "scale": "", "offset": "mm", "friction": "", "clearance": "µm"})
LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType({
    "tilt": (-30.0, 30.0),
    "scale": (0.2, 3.0),
    "offset": (-10.0, 10.0),
    "friction": (0.0, 2.0),
    "clearance": (1.0, 1000.0),
})  # fmt: skip
"""Range of each quantity; below it a value has the wrong unit, or the peg would be wider than the hole."""

WHY = MappingProxyType({
    "tilt": "", "offset": "", "friction": "",
    "scale": ": with the same gains a much larger or smaller part cannot be inserted in time",
    "clearance": ": without any the peg is wider than the hole",
})  # fmt: skip
"""What lies beyond the range, for messages."""

SCENARIO_HELP = '"tilt=-4,scale=0.5,offset=0.3,friction=0.2,clearance=15" [deg, 1, mm, 1, µm], any of them'

SCENARIOS = MappingProxyType({
    scenario.name: scenario
    for scenario in (
        PegScenario(),
        *(PegScenario(tilt=tilt) for tilt in (-6.0, -4.0, 0.0, 2.0)),
        *(PegScenario(scale=scale) for scale in (0.3, 0.5, 0.7, 0.9)),
    )
})  # fmt: skip
"""The training scenario, tilt −2° and scale 1, and the published unseen ones."""


def as_scenario(scenario: Any) -> PegScenario:
    """A scenario from its name or from ``quantity=value`` pairs with commas; a scenario stays as it is.

    Raises
    ------
    InputError
        Neither of them, an unknown quantity, or a value out of range.
    """
    if isinstance(scenario, PegScenario):
        return scenario
    if not isinstance(scenario, str):
        raise InputError(f"scenario is {scenario!r}; pass a name or {SCENARIO_HELP}.")
    if "=" not in scenario:
        return SCENARIOS[one_of("scenario", scenario, SCENARIOS)]
    values: dict[str, float] = {}
    for pair in scenario.split(","):
        name, _, value = (part.strip() for part in pair.partition("="))
        if one_of("quantity of a scenario", name, UNITS) in values:
            raise InputError(f"scenario is {scenario!r}; it gives {name} twice.")
        try:
            values[name] = float(value)
        except ValueError:
            raise InputError(f"{name} is {value!r}; pass a number, as in {SCENARIO_HELP}.") from None
    return PegScenario(**values)


def build_spec(scenario: PegScenario, *, wedge_count: int | None = None) -> mujoco.MjSpec:
    """The scene of a scenario's geometry, as it is simulated.

    Parameters
    ----------
    scenario : PegScenario
    wedge_count : int, optional
        Build the hole of so many convex wedges, a polygon, instead of the round one; for comparisons.

    Raises
    ------
    ModelError
        The peg's description does not have the parts that the scene needs.
    """
    scale, friction, clearance = scenario.geometry
    spec = _peg(scale, HOLE_RADIUS - 1e-6 * clearance)
    option = spec.option
    option.timestep, option.integrator = TIMESTEP, mujoco.mjtIntegrator.mjINT_DISCRETE
    option.cone, option.iterations, option.tolerance = mujoco.mjtCone.mjCONE_ELLIPTIC, 50, 1e-10
    option.ccd_tolerance = 1e-9
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence must stay visible
    contact = {"friction": [friction, 0.0, 0.0], "solref": SOLREF, "solimp": SOLIMP, "condim": 3}
    for name, value in contact.items():
        setattr(spec.geom("peg"), name, value)
    hole = {
        "radius": scale * HOLE_RADIUS,
        "chamfer": scale * CHAMFER,
        "depth": scale * BORE_DEPTH,
        "half_width": scale * BLOCK,
        "contype": _BLOCK,
        "conaffinity": _PEG,
        **contact,
    }
    if wedge_count is None:
        collider.add_hole(spec, "block", **hole)
    else:
        wedges.add_hole(spec, "block", count=wedge_count, **hole)
    spec.worldbody.add_site(name="goal", pos=[0.0, 0.0, scale * (TIP_DISTANCE - GOAL_DEPTH)])
    _add_impedance(spec)
    return spec


@functools.lru_cache(maxsize=64)
def physics_model(
    geometry: tuple[float, float, float], wedge_count: int | None = None, *, time_step: float = TIMESTEP
) -> mujoco.MjModel:
    """The model of a geometry (scale, friction, clearance) and a time step [s], compiled once in a process."""
    scale, friction, clearance = geometry
    scenario = PegScenario(scale=scale, friction=friction, clearance=clearance)
    spec = build_spec(scenario, wedge_count=wedge_count)
    spec.option.timestep = time_step
    return spec.compile()


def _peg(scale: float, radius: float) -> mujoco.MjSpec:
    """The free peg of ``robots/peg`` in another size; its mass and inertia stay."""
    description = find_robot("peg", kind="object")
    spec = mujoco.MjSpec.from_file(str(description.urdf))
    spec.modelname = "peg_in_hole"
    body, tip = spec.body("peg"), spec.body("tip")
    if body is None or tip is None or abs(tip.pos[2] + TIP_DISTANCE) > 1e-12:
        raise ModelError(
            f"{description.urdf} has no peg whose tip is {TIP_DISTANCE} m below its centre of mass."
        )
    solid = [geom for geom in body.geoms if geom.contype]
    for geom in set(body.geoms) - set(solid):
        spec.delete(geom)
    (geom,) = solid
    geom.name, geom.size = "peg", [scale * radius, scale * geom.size[1], 0.0]
    geom.contype, geom.conaffinity = _PEG, _BLOCK
    tip.pos = [0.0, 0.0, -scale * TIP_DISTANCE]
    body.pos = [0.0, 0.0, 2.0 * scale * TIP_DISTANCE]
    body.gravcomp = 1.0  # the law compensates gravity
    body.add_freejoint(name="peg")
    body.add_site(name="com")
    return spec


def _add_impedance(spec: mujoco.MjSpec) -> None:
    """Six actuators of force ``ctrl − k e − b ė`` at the peg's centre of mass, along and about the world's axes."""
    for axis in range(6):
        actuator = spec.add_actuator(
            name=f"impedance_{axis}",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target="com",
            refsite="goal",
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        )
        gear = [0.0] * 6
        gear[axis] = 1.0
        actuator.gear = gear
        actuator.gainprm[0] = 1.0
        actuator.biasprm[:3] = [0.0, 0.0, -DAMPING[axis]]
