"""The round hole: contacts exact against brute force, symmetric, passive, and nobody else's model is touched."""

from __future__ import annotations

import ctypes
import functools
import multiprocessing
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from mujoco import batch

from benchmarks import brute_force
from benchmarks import collider as benchmark
from vic_toolbox.errors import InputError, SimulationError
from vic_toolbox.spatial import rotation_exp, rotation_to_quat_wxyz
from vic_toolbox.tasks import bore, bore_contacts, collider, mujoco_structs

PEG, HOLE = benchmark.PEG, benchmark.HOLE
SMALL = (6.34e-3, 30e-3), (6.35e-3, 0.5e-3, 12e-3, 1.0)
MARGIN = benchmark.MARGIN
HARD = {"solref": [0.002, 1.0], "solimp": [0.999, 0.9999, 1e-5, 0.5, 2.0], "condim": 3}


def contacts(
    position: Any, axis: Any, *, peg: Any = PEG, hole: Any = HOLE, margin: float = MARGIN
) -> np.ndarray:
    """Rows of distance, position, normal."""
    rows = np.zeros((bore_contacts.MAX_CONTACTS, 10))
    count = bore_contacts.contacts(rows, tuple(position), tuple(axis), peg, hole, margin)
    return rows[:count, :7]


def pose(tilt: float, azimuth: float, tip: Any, *, peg: Any = PEG) -> tuple[np.ndarray, np.ndarray]:
    """Centre and axis of a peg from its tilt and azimuth [rad] and the centre of its lower face [m]."""
    axis = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    return np.asarray(tip) + peg[1] * axis, axis


poses = st.builds(
    lambda tilt, azimuth, x, y, z: pose(tilt, azimuth, (x, y, z)),
    st.floats(0.0, 0.15),
    st.floats(-np.pi, np.pi),
    st.floats(-2e-3, 2e-3),
    st.floats(-2e-3, 2e-3),
    st.floats(-20e-3, 2e-3),
)


# --- geometry -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", benchmark.PLACES)
def test_distance_equals_brute_force(place: str) -> None:
    rng = np.random.default_rng(7)
    for given_pose in benchmark.separated_poses(rng, place, 8):
        true = brute_force.peg_distance(*given_pose, peg=PEG, hole=HOLE)
        assert benchmark.reported_distance(*given_pose) == pytest.approx(true, abs=0.05e-6)


@pytest.mark.parametrize("place", benchmark.PLACES)
def test_every_depth_is_the_way_out_of_the_overlap(place: str) -> None:
    rng = np.random.default_rng(8)
    poses_ = benchmark.overlapping_poses(rng, place, 15)
    assert np.abs(np.concatenate([benchmark.contact_errors(*p) for p in poses_])).max() < 6e-6


@pytest.mark.parametrize(
    ("tilt", "tip"),
    [
        (0.9, (-8e-3, -7e-3, 2e-3)),  # hardly in, far over
        (1.3, (-20e-3, -17e-3, 8e-3)),  # the side leans on the mouth's edge
        (0.0009, (1e-5, -3e-6, -24.99e-3)),  # at the lower edge of the hole
        (0.0009, (1e-5, 0.0, -40e-3)),  # through it
        (np.pi / 2, (-60e-3, 0.0, 12.70e-3)),  # lying across the mouth
    ],
)
def test_distance_in_uncommon_places(tilt: float, tip: tuple[float, float, float]) -> None:
    position, axis = pose(tilt, 0.7, tip)
    for _ in range(40):
        rows = contacts(position, axis)
        deepest = rows[rows[:, 0].argmin()]
        if deepest[0] >= 1e-6:
            break
        position = position + (2e-6 - deepest[0]) * deepest[4:7]
    true = brute_force.peg_distance(position, axis, peg=PEG, hole=HOLE)
    assert deepest[0] == pytest.approx(true, abs=0.05e-6)


def test_blind_hole_holds_the_peg_at_its_bottom() -> None:
    peg, hole = SMALL
    rows = contacts(*pose(0.0, 0.0, (0.0, 0.0, -hole[2] - 1e-6), peg=peg), peg=peg, hole=hole, margin=0.0)
    assert rows.shape == (4, 7)
    np.testing.assert_allclose(rows[:, 0], -1e-6, atol=1e-12)
    np.testing.assert_allclose(rows[:, 4:7], [[0.0, 0.0, 1.0]] * 4, atol=1e-12)
    tilted = pose(1e-3, 0.4, (0.0, 0.0, -hole[2] + 7e-6), peg=peg)
    true = brute_force.peg_distance(*tilted, peg=peg, hole=hole)
    assert contacts(*tilted, peg=peg, hole=hole)[:, 0].min() == pytest.approx(true, abs=0.05e-6)


@given(poses, st.floats(-np.pi, np.pi))
def test_turning_peg_and_hole_keeps_the_distances(given_pose: Any, angle: float) -> None:
    position, axis = given_pose
    turn = rotation_exp(np.array([0.0, 0.0, angle]))
    rows, turned = contacts(position, axis), contacts(turn @ position, turn @ axis)
    assume(np.hypot(axis[0], axis[1]) > 1e-6)  # upright, which of equal places are named is arbitrary
    assert len(rows) == len(turned)
    # of places that are equally deep, which one is named is arbitrary
    np.testing.assert_allclose(turned[:, 0], rows[:, 0], atol=1e-10)


@given(st.floats(1e-3, 0.5), st.floats(-np.pi, np.pi), st.floats(1e-4, 5e-3))
def test_the_deepest_contact_turns_along(tilt: float, angle: float, off: float) -> None:
    """Where the peg leans on one place of the mouth, that place turns along."""
    position, axis = pose(tilt, 0.0, (off, 0.0, -1e-3))
    turn = rotation_exp(np.array([0.0, 0.0, angle]))
    rows, turned = contacts(position, axis), contacts(turn @ position, turn @ axis)
    deepest, again = rows[rows[:, 0].argmin()], turned[turned[:, 0].argmin()]
    assume((rows[:, 0] < deepest[0] + 1e-7).sum() == 1)
    np.testing.assert_allclose(again[1:4], turn @ deepest[1:4], atol=1e-6)
    np.testing.assert_allclose(again[4:7], turn @ deepest[4:7], atol=1e-6)


@given(poses)
def test_mirrored_peg_has_mirrored_distances(given_pose: Any) -> None:
    position, axis = given_pose
    mirror = np.array([1.0, -1.0, 1.0])
    rows, mirrored = contacts(position, axis), contacts(mirror * position, mirror * axis)
    assert bool(len(rows)) == bool(len(mirrored))
    if len(rows):
        assert rows[:, 0].min() == pytest.approx(mirrored[:, 0].min(), abs=1e-10)


@given(poses)
def test_a_peg_has_no_head(given_pose: Any) -> None:
    position, axis = given_pose
    np.testing.assert_array_equal(contacts(position, axis), contacts(position, -axis))


@given(poses, st.sampled_from([0.3, 2.0, 1000.0]))
def test_all_lengths_scale_together(given_pose: Any, scale: float) -> None:
    position, axis = given_pose
    rows = contacts(position, axis)
    peg, hole = (scale * PEG[0], scale * PEG[1]), (*(scale * length for length in HOLE[:3]), HOLE[3])
    scaled = contacts(scale * position, axis, peg=peg, hole=hole, margin=scale * MARGIN)
    assert bool(len(rows)) == bool(
        len(scaled)
    )  # in a symmetric pose, which of equal places are named is arbitrary
    if len(rows):
        assert scaled[:, 0].min() == pytest.approx(scale * rows[:, 0].min(), abs=1e-10 * scale)


@given(poses, st.floats(0.0, MARGIN))
def test_contacts_are_within_the_margin_and_normals_of_unit_length(given_pose: Any, margin: float) -> None:
    rows = contacts(*given_pose, margin=margin)
    assert len(rows) <= bore_contacts.MAX_CONTACTS
    assert np.isfinite(rows).all()
    assert (rows[:, 0] < margin).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:7], axis=1), 1.0, atol=1e-12)


@given(st.floats(0.0, 1.5), st.floats(-np.pi, np.pi), st.floats(1e-6, 1e-2))
def test_no_contact_clear_above_the_plate(tilt: float, azimuth: float, clear: float) -> None:
    lowest = PEG[0] * np.sin(tilt)
    assert len(contacts(*pose(tilt, azimuth, (1e-3, 0.0, lowest + clear)), margin=0.0)) == 0


@given(st.floats(0.0, 1.0), st.floats(-np.pi, np.pi), st.floats(0.0, 14.9e-6), st.floats(0.0, 25e-3))
def test_no_contact_in_the_middle_of_the_bore(share: float, azimuth: float, off: float, deep: float) -> None:
    place = (share * off * np.cos(azimuth), share * off * np.sin(azimuth), -deep)
    assert len(contacts(*pose(0.0, 0.0, place), margin=0.0)) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_pose_that_is_not_finite_has_no_contacts(bad: float) -> None:
    for k in range(6):
        numbers = [0.0, 0.0, 0.05, 0.0, 0.0, 1.0]
        numbers[k] = bad
        assert len(contacts(numbers[:3], numbers[3:])) == 0


@given(st.floats(8e-3, 16e-3), st.floats(-3e-3, 3e-3))
def test_profile_distance_has_a_unit_gradient(rho: float, z: float) -> None:
    step = 1e-7
    distance, normal_rho, normal_z = bore.profile_distance(rho, z, HOLE[0], HOLE[1])
    assert np.hypot(normal_rho, normal_z) == pytest.approx(1.0)
    moved, *_ = bore.profile_distance(rho + step * normal_rho, z + step * normal_z, HOLE[0], HOLE[1])
    assert moved - distance == pytest.approx(step, rel=1e-3)


# --- in MuJoCo ------------------------------------------------------------------------------------------------------


def scene(
    *, hole: Any = HOLE, friction: float = 0.0, timestep: float = 1e-3, margin: float = 0.0
) -> mujoco.MjModel:
    """A free peg above a hole, with hard contacts."""
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.integrator = timestep, mujoco.mjtIntegrator.mjINT_DISCRETE
    option.cone, option.ccd_tolerance = mujoco.mjtCone.mjCONE_ELLIPTIC, 1e-9
    option.iterations, option.tolerance = 50, 1e-10
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    contact = {"friction": [friction, 0.0, 0.0], **HARD}
    radius, chamfer, depth, closed = hole
    measures = {"radius": radius, "chamfer": chamfer, "depth": depth, "closed": bool(closed)}
    collider.add_hole(spec, "hole", half_width=3.0 * radius, margin=margin, **measures, **contact)
    body = spec.worldbody.add_body(name="peg", pos=[0.0, 0.0, 2.0 * PEG[1]])
    body.add_freejoint()
    body.explicitinertial, body.ipos = True, [0.0, 0.0, 0.0]
    body.mass, body.inertia = 0.5, [8.2e-4, 8.2e-4, 3e-4]
    body.add_geom(name="peg", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[*PEG, 0.0], **contact)
    return spec.compile()


def place(data: mujoco.MjData, position: Any, axis: Any) -> None:
    quat = np.zeros(4)
    mujoco.mju_quatZ2Vec(quat, np.asarray(axis))
    data.qpos[:] = [*position, *quat]


@pytest.fixture(autouse=True)
def _installed() -> Any:
    collider.install()
    yield
    collider.install()


def test_mujoco_finds_the_contacts_of_the_collider_however_deep() -> None:
    model = scene(margin=MARGIN)
    data = mujoco.MjData(model)
    for deep in (0.0, 0.5e-3, 5e-3, 15e-3, 24.9e-3, 60e-3, 100e-3):
        position, axis = pose(0.004, 0.3, (16e-6, 3e-6, -deep))
        place(data, position, axis)
        mujoco.mj_forward(model, data)
        rows = contacts(data.geom_xpos[1], data.geom_xmat[1, 2::3])
        assert data.ncon == len(rows) > 0
        np.testing.assert_allclose(data.contact.dist, rows[:, 0], atol=1e-15)
        np.testing.assert_allclose(data.contact.pos, rows[:, 1:4], atol=1e-15)
        np.testing.assert_allclose(data.contact.frame[:, :3], rows[:, 4:7], atol=1e-12)


def test_a_hole_may_stand_anywhere_and_there_may_be_several() -> None:
    spec = mujoco.MjSpec()
    small, large = (6.34e-3, 20e-3), (12.69e-3, 30e-3)
    quat = rotation_to_quat_wxyz(rotation_exp(np.array([0.4, -0.8, 0.2])))
    for name, radius, pos in (("small", 6.35e-3, [0.1, 0.0, 0.0]), ("large", 12.70e-3, [-0.1, 0.2, 0.3])):
        collider.add_hole(
            spec, name, radius=radius, chamfer=4e-4, depth=15e-3, half_width=0.03, pos=pos, quat=quat
        )
    for name, peg in (("small", small), ("large", large)):
        body = spec.worldbody.add_body(name=f"{name} peg")
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[*peg, 0.0], mass=1.0, margin=1e-4)
    model = spec.compile()
    data = mujoco.MjData(model)
    turn = rotation_exp(np.array([0.4, -0.8, 0.2]))
    for i, (name, peg) in enumerate((("small", small), ("large", large))):
        position, axis = pose(0.001, 1.0, (2e-6, 4e-6, -5e-3), peg=peg)
        place_of_hole = model.geom(name).pos
        quat_peg = np.zeros(4)
        mujoco.mju_quatZ2Vec(quat_peg, turn @ axis)
        data.qpos[7 * i : 7 * i + 7] = [*(place_of_hole + turn @ position), *quat_peg]
    mujoco.mj_forward(model, data)
    for i, (radius, peg) in enumerate(((6.35e-3, small), (12.70e-3, large))):
        position, axis = pose(0.001, 1.0, (2e-6, 4e-6, -5e-3), peg=peg)
        rows = contacts(position, axis, peg=peg, hole=(radius, 4e-4, 15e-3, 0.0), margin=1e-4)
        found = data.contact.dist[data.contact.geom[:, 0] == i]
        assert len(rows) > 0
        np.testing.assert_allclose(np.sort(found), np.sort(rows[:, 0]), atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.25])
def test_a_dropped_peg_never_gains_energy(friction: float) -> None:
    rng = np.random.default_rng(1)
    hole = (*HOLE[:3], 1.0)
    for timestep, steps in ((1e-3, 250), (2.5e-4, 700)):
        model = scene(hole=hole, friction=friction, timestep=timestep)
        data = mujoco.MjData(model)
        for _ in range(6):
            mujoco.mj_resetData(model, data)
            tilt = np.radians(rng.uniform(0.0, 6.0))
            tip = [*rng.uniform(-1e-3, 1e-3, 2), PEG[0] * np.sin(tilt) + rng.uniform(0.1e-3, 3e-3)]
            place(data, *pose(tilt, rng.uniform(0.0, 6.28), tip))
            mujoco.mj_forward(model, data)
            free = start = data.energy.sum()
            for _ in range(steps):
                mujoco.mj_step(model, data)
                assert data.energy.sum() < start + 1e-9  # contacts that are compressed hold some, never more
                if data.ncon == 0:
                    assert data.energy.sum() < free + 1e-5
                    free = min(free, data.energy.sum())


@pytest.mark.parametrize("offset", [20e-3, 12e-3, 8e-3, 5e-3])
def test_a_flat_peg_rests_on_the_plate(offset: float) -> None:
    """Beside the hole, and over its mouth as long as the plate supports its centre."""
    model = scene(friction=0.3)
    data = mujoco.MjData(model)
    place(data, [offset, 0.0, PEG[1]], [0.0, 0.0, 1.0])
    start = data.qpos.copy()
    for _ in range(1000):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, start, atol=2e-6)


def test_a_peg_that_is_slightly_off_falls_into_the_hole_and_through_it() -> None:
    model = scene(friction=0.05)
    data = mujoco.MjData(model)
    place(data, *pose(np.radians(0.5), 0.3, (2e-4, 0.0, 0.5e-3)))
    for _ in range(400):
        mujoco.mj_step(model, data)
    assert data.qpos[2] < -PEG[1]


def test_a_diverged_simulation_does_no_harm() -> None:
    model = scene()
    data = mujoco.MjData(model)
    for bad in (np.nan, np.inf):
        data.qpos[:3] = bad
        mujoco.mj_forward(model, data)
        assert data.ncon == 0


# --- in MuJoCo's table ----------------------------------------------------------------------------------------------


def test_installing_and_uninstalling() -> None:
    assert collider.installed()
    collider.install()
    model = scene()
    data = mujoco.MjData(model)
    place(data, *pose(0.0, 0.0, (0.0, 0.0, -5e-3)))
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    collider.uninstall()
    assert not collider.installed()
    mujoco.mj_forward(model, data)
    assert data.ncon > 0  # a flat plate
    collider.uninstall()
    collider.install()
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def ordinary_contacts() -> np.ndarray:
    """Contacts of cylinders with height fields that are no holes: bumps, and flat ones with other user data."""
    xml = """<mujoco><asset><hfield name="bumps" nrow="3" ncol="3" size="1 1 .2 .1" elevation="0 1 0 2 1 0 1 1 2"/>
    <hfield name="flat" nrow="2" ncol="2" size="1 1 1e-3 .1" elevation="0 0 0 0"/></asset><worldbody>
    <geom type="hfield" hfield="bumps"/><geom type="hfield" hfield="flat" pos="3 0 0" {user}/>
    <body pos="0 0 .2" euler="20 30 0"><freejoint/><geom type="cylinder" size=".1 .2"/></body>
    <body pos="3 0 .0999" euler="90 0 0"><freejoint/><geom type="cylinder" size=".1 .2"/></body>
    </worldbody></mujoco>"""
    found = []
    for user in ("", 'user="1"', 'user="1 2 3 4 5 6"', f'user="0 {collider.TAG:.17g} .01 .02 .1 0"'):
        model = mujoco.MjModel.from_xml_string(xml.format(user=user))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert data.ncon > 2
        found.append(np.hstack([data.contact.dist[:, None], data.contact.pos, data.contact.frame]))
    return np.concatenate(found)


def test_other_height_fields_are_left_to_mujoco() -> None:
    ours = ordinary_contacts()
    collider.uninstall()
    np.testing.assert_array_equal(ours, ordinary_contacts())


def insertion(threads: int = 1) -> np.ndarray:
    """States of pegs that fall toward a hole, after some steps."""
    model = scene(friction=0.2)
    simulations = batch.Batch(model, 12, threads)
    data = mujoco.MjData(model)
    qpos = simulations.bind("qpos")
    for i in range(12):
        place(data, *pose(0.004 * i, 0.5 * i, (1e-4 * i, -5e-5 * i, 1e-3)))
        qpos[i] = data.qpos
    simulations.step(nstep=300)
    return np.hstack([qpos, simulations.bind("qvel")])


def test_same_bits_on_any_number_of_threads_and_after_installing_again() -> None:
    reference = insertion()
    assert np.isfinite(reference).all()
    np.testing.assert_array_equal(insertion(threads=4), reference)
    collider.uninstall()
    assert (insertion() != reference).any()
    collider.install()
    np.testing.assert_array_equal(insertion(), reference)


def _in_another_process(_: int) -> tuple[bool, np.ndarray]:
    before = collider.installed()
    collider.install()
    return before, insertion()


def test_same_bits_in_a_spawned_process() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        before, states = pool.map(_in_another_process, [0])[0]
    assert not before
    np.testing.assert_array_equal(states, insertion())


def test_another_memory_layout_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    collider.uninstall()
    collider._compile.cache_clear()
    true = mujoco_structs.struct_offsets

    def shifted(struct: str, fields: Any) -> dict[str, int]:
        return {field: offset + 8 * (field == wrong) for field, offset in true(struct, fields).items()}

    monkeypatch.setattr(collider, "struct_offsets", shifted)
    for wrong in ("geom_xmat", "geom_user", "nuser_geom", "normal"):
        with pytest.raises(SimulationError, match=rf"{wrong}.*mujoco==4\.0"):
            collider.install()
        assert not collider.installed()
    monkeypatch.undo()
    collider.install()
    assert collider.installed()


def test_wrong_contacts_of_the_probe_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    collider.uninstall()
    monkeypatch.setattr(bore_contacts, "contacts", lambda *arguments: 0)
    with pytest.raises(SimulationError, match="contacts of a probe"):
        collider.install()
    assert not collider.installed()


def test_a_foreign_function_is_refused_not_replaced() -> None:
    collider.uninstall()
    table, place_ = collider._table(), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
    mujocos_own = table[place_]
    foreign = collider._Collide(lambda *arguments: 0)
    address = ctypes.cast(foreign, ctypes.c_void_p).value
    try:
        table[place_] = address
        for call in (collider.install, collider.uninstall):
            with pytest.raises(SimulationError, match="replaced by another program part"):
                call()
        assert not collider.installed()
        assert table[place_] == address
    finally:
        table[place_] = mujocos_own


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": 0.0}, "radius is 0; every entry must be greater"),
        ({"radius": np.nan}, "radius is nan"),
        ({"chamfer": -1e-3}, "chamfer is -0.001"),
        ({"chamfer": 30e-3}, "deeper than its chamfer"),
        ({"depth": "deep"}, "depth"),
        ({"half_width": 13e-3}, "make the plate wider"),
        ({"size": [1.0, 1.0, 1.0]}, "size: add_hole sets this itself"),
        ({"type": mujoco.mjtGeom.mjGEOM_BOX, "userdata": [1.0]}, "type, userdata: add_hole sets"),
    ],
)
def test_bad_holes_are_refused(change: dict[str, Any], message: str) -> None:
    make: Any = functools.partial(collider.add_hole, mujoco.MjSpec(), "hole")
    good = {"radius": 12.7e-3, "chamfer": 0.4e-3, "depth": 25e-3, "half_width": 30e-3}
    with pytest.raises(InputError, match=message):
        make(**(good | change))


def test_a_spec_without_room_for_user_data_is_refused() -> None:
    spec = mujoco.MjSpec()
    spec.nuser_geom = 2
    with pytest.raises(InputError, match="nuser_geom = 2; set it to -1"):
        collider.add_hole(spec, "hole", radius=12.7e-3, chamfer=0.4e-3, depth=25e-3, half_width=30e-3)
    assert not spec.hfields
