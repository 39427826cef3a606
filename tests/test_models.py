"""Robot models: published numbers, Pinocchio against MuJoCo, and the theorems of rigid-body dynamics."""

from __future__ import annotations

import functools
import shutil
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import FileError, InputError, ModelError, VicError
from vic_toolbox.models import (
    RobotModel,
    SingularityWarning,
    available_robots,
    find_robot,
    load_robot,
    robots_directory,
)
from vic_toolbox.models.catalogue import example_robots_directory, read_description
from vic_toolbox.models.operational_space import SMALLEST_MOBILITY

FANUC = "fanuc_lrmate200id7l"
CUP = "cup_gripper"
DEGREES = np.pi / 180
ARMS = sorted(available_robots())

robot = functools.cache(load_robot)
seeds = st.integers(0, 2**32 - 1)


def states(model: RobotModel, count: int, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return model.random_postures(generator, count), generator.normal(size=(count, model.nv))


# ---------------------------------------------------------------------------------------- the catalogue


def test_own_robots_are_listed_by_kind():
    assert FANUC in available_robots("arm")
    assert list(available_robots("tool")) == [CUP]
    assert list(available_robots("object")) == ["peg"]
    assert {FANUC, CUP, "peg", "panda", "ur5"} <= available_robots(None).keys()


def test_example_arms_are_found_and_nothing_else():
    expected = {"panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "z1", "so100", "so101", "talos_left_arm"}
    assert expected <= set(ARMS)
    assert not {"anymal", "talos_reduced", "tiago", "allegro_left_hand", "double_pendulum"} & set(ARMS)


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_loads_and_computes(name: str):
    model = robot(name)
    assert model.nq == model.nv == len(model.joint_names) == len(model.home)
    assert (model.lower <= model.home).all()
    assert (model.home <= model.upper).all()
    assert np.linalg.eigvalsh(model.mass_matrix(model.home)).min() > 0
    assert np.isfinite(model.bias(model.home, np.ones(model.nv))).all()


@pytest.mark.parametrize(("name", "joints", "frame"), [("panda", 7, "panda_hand_tcp"), ("ur5", 6, "tool0")])
def test_the_end_effector_is_guessed(name: str, joints: int, frame: str):
    assert (robot(name).nq, robot(name).frame) == (joints, frame)


def test_fingers_are_locked_and_keep_their_mass():
    panda = robot("panda")
    assert panda.locked_joints == ("panda_finger_joint1", "panda_finger_joint2")
    whole = pin.buildModelFromUrdf(str(panda.urdf_path))
    assert pin.computeTotalMass(panda.pinocchio) == pytest.approx(pin.computeTotalMass(whole), rel=1e-14)
    q, v = states(panda, 1)
    fingers = np.zeros(2)
    torque = pin.nonLinearEffects(whole, whole.createData(), np.r_[q[0], fingers], np.r_[v[0], fingers])
    np.testing.assert_allclose(panda.bias(q[0], v[0]), torque[:7], atol=1e-12)


def test_endless_joints_are_plain_angles():
    kinova = robot("kinova")
    assert np.isinf(kinova.upper).sum() == 3
    q, _ = states(kinova, 1)
    turned = q[0] + 2 * np.pi * np.isinf(kinova.upper)
    np.testing.assert_allclose(kinova.pose(turned), kinova.pose(q[0]), atol=1e-12)


def test_paths_lead_to_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = shutil.copytree(robots_directory() / FANUC, tmp_path / "mine")
    for path in (folder, str(folder), folder / "robot.toml"):
        assert load_robot(path).armature[0] == 0.6
    assert load_robot(folder / f"{FANUC}.urdf").armature[0] == 0.0
    (tmp_path / "panda").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_robot("panda").nq == 7, "a name is a name, whatever lies in the working directory"


def test_named_postures_make_a_home():
    np.testing.assert_allclose(robot("panda").home[[1, 3]], [-0.785398, -2.35619])


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: load_robot("no_such_arm"), InputError, "panda"),
        (lambda: load_robot("nowhere/arm.urdf"), FileError, "nowhere"),
        (lambda: load_robot(Path("nowhere")), FileError, "robot.toml"),
        (lambda: load_robot("peg"), ModelError, "object"),
        (lambda: load_robot(FANUC, tool="peg"), ModelError, CUP),
        (lambda: load_robot(FANUC, tool=FANUC), ModelError, CUP),
        (lambda: load_robot(FANUC, frame="nose"), ModelError, "tool0"),
        (lambda: load_robot(FANUC, armature=[1.0]), InputError, "shape"),
        (lambda: load_robot(FANUC, armature=[-1.0] * 6), InputError, "armature"),
        (lambda: load_robot("solo12"), ModelError, "no serial arm"),
        (lambda: load_robot(FANUC, tool=robot("panda").urdf_path), ModelError, "rigid"),
        (lambda: available_robots("leg"), InputError, "tool"),
    ],
)
def test_bad_requests_say_what_to_do(call, error: type[VicError], message: str):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(
    "text", ["", "<robot/>", "<robot name='x'>", "<mujoco/>", "<robot name='x'></robot>"]
)
def test_a_file_that_is_no_urdf_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "broken.urdf"
    path.write_text(text)
    with pytest.raises(ModelError, match="broken"):
        load_robot(path)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (("kind =", "kinds ="), ModelError, "kinds"),
        (('kind = "arm"', 'kind = "leg"'), InputError, "object"),
        (('kind = "arm"', "kind = 3"), ModelError, "string"),
        (("[provenance]", "["), FileError, "TOML"),
        (("home = [0.0,", "home = [nan,"), InputError, "home"),
        (("home = [0.0,", "home = [9.0,"), InputError, "home"),
        (("home = [0.0,", "home = ["), InputError, "home"),
    ],
)
def test_a_bad_description_is_refused(tmp_path: Path, change: tuple[str, str], error: type, message: str):
    folder = shutil.copytree(robots_directory() / FANUC, tmp_path / "arm")
    file = folder / "robot.toml"
    file.write_text(file.read_text().replace(*change))
    with pytest.raises(error, match=message):
        load_robot(folder)


def test_descriptions_say_what_is_assumed():
    for path in robots_directory().glob("*/robot.toml"):
        assert read_description(path).provenance
    assert "assumed" in find_robot(FANUC).provenance["armature"]


def test_without_example_robot_data_the_own_robots_remain(monkeypatch: pytest.MonkeyPatch):
    assert example_robots_directory() is not None
    monkeypatch.setattr("vic_toolbox.models.catalogue.example_robots_directory", lambda: None)
    assert list(available_robots()) == [FANUC]


# ------------------------------------------------------------------------- the LR Mate's published numbers


def test_joints_are_the_published_ones():
    arm = robot(FANUC)
    np.testing.assert_allclose(arm.lower / DEGREES, [-180, -100, -70, -190, -125, -360], atol=1e-6)
    np.testing.assert_allclose(arm.upper / DEGREES, [180, 145, 213, 190, 125, 360], atol=1e-6)
    np.testing.assert_allclose(arm.velocity_limits / DEGREES, [370, 310, 410, 550, 545, 1000], atol=1e-6)
    np.testing.assert_array_equal(arm.effort_limits, [600, 600, 300, 70, 40, 20])
    np.testing.assert_array_equal(arm.armature, [0.6, 0.6, 0.3, 0.15, 0.15, 0.1])
    axes = arm.jacobian(np.zeros(6))[3:].T
    expected = [[0, 0, 1], [0, 1, 0], [0, -1, 0], [-1, 0, 0], [0, -1, 0], [-1, 0, 0]]
    np.testing.assert_allclose(axes, expected, atol=1e-15)


def test_masses_are_the_published_ones():
    inertias = list(robot(FANUC).pinocchio.inertias)
    np.testing.assert_allclose([i.mass for i in inertias], [5.09, 5.41, 10.9, 2.07, 3.07, 0.428, 0.0129])
    np.testing.assert_allclose(inertias[4].lever, [0.266, 0.00354, 0.00226])
    products = [[0.28, 3.24e-5, 7.18e-4], [3.24e-5, 0.255, -0.00195], [7.18e-4, -0.00195, 0.0511]]
    np.testing.assert_allclose(inertias[2].inertia, products)
    assert sum(i.mass for i in inertias) == pytest.approx(27, abs=0.02)


@pytest.mark.parametrize(
    ("wrist", "position", "forward"), [(0, (0.55, 0, 0.805), (1, 0, 0)), (-90, (0.47, 0, 0.725), (0, 0, -1))]
)
def test_tool0_is_where_the_manufacturer_says(wrist: float, position: tuple, forward: tuple):
    pose = robot(FANUC).pose(np.array([0, 0, 0, 0, wrist, 0]) * DEGREES)
    np.testing.assert_allclose(pose[:3, 3], position, atol=1e-12)
    np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-12)


def test_reach_to_the_wrist_centre():
    arm = robot(FANUC)

    def reach(shoulder: np.ndarray, elbow: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(elbow)
        q = np.stack([zero, shoulder + zero, elbow, zero, zero, zero], axis=-1) * DEGREES
        return arm.pose(q, "link_5")[..., 0, 3]

    assert reach(np.array(90.0), np.array(85.2)) == pytest.approx(0.9115, abs=5e-5)
    shoulders, elbows = np.meshgrid(np.arange(60, 120, 2.0), np.arange(60, 120, 2.0))
    assert reach(shoulders, elbows).max() <= 0.9115


def test_the_cup_extends_the_arm():
    arm = robot(FANUC, tool=CUP)
    assert arm.frame == "cup_bottom"
    offset = np.linalg.inv(arm.pose(arm.home, "tool0")) @ arm.pose(arm.home)
    np.testing.assert_allclose(offset[:3, 3], [0, 0, 0.216], atol=1e-12)
    np.testing.assert_allclose(offset[:3, :3], np.eye(3), atol=1e-12)
    mass = pin.computeTotalMass(arm.pinocchio) - pin.computeTotalMass(robot(FANUC).pinocchio)
    assert mass == pytest.approx(0.30 + 0.70 + 0.15)


def test_a_tool_can_be_changed():
    arm = robot(FANUC).with_tool(CUP)
    np.testing.assert_array_equal(arm.mass_matrix(arm.home), robot(FANUC, tool=CUP).mass_matrix(arm.home))
    assert robot("panda").with_tool(CUP, frame="panda_hand").frame == "panda_hand"


# --------------------------------------------------------------------------------- Pinocchio and MuJoCo


def mujoco_model(model: RobotModel) -> mujoco.MjModel:
    """The same URDF in MuJoCo: without shapes (their meshes are elsewhere), with the locked joints fixed."""

    def read(path: Path) -> mujoco.MjSpec:
        root = ElementTree.parse(path).getroot()
        for link in root.iter("link"):
            for shape in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(shape)
        for joint in root.iter("joint"):
            if joint.get("name") in model.locked_joints:
                joint.set("type", "fixed")
        for extension in root.findall("mujoco"):
            root.remove(extension)
        compiler = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
        compiler.attrib.update(fusestatic="false", balanceinertia="false", boundmass="0", boundinertia="0")
        return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))

    spec = read(model.urdf_path)
    if model.tool_urdf_path is not None:
        site = spec.body(model.mount).add_site()
        spec.attach(read(model.tool_urdf_path), site=site, prefix="tool/")
    compiled = spec.compile()
    compiled.dof_armature[:] = model.armature
    compiled.dof_damping[:] = compiled.dof_frictionloss[:] = 0  # some URDFs name them; no rigid-body term
    return compiled


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Full M from MuJoCo's sparse lower triangle."""
    dense = np.zeros((model.nv, model.nv))
    mujoco.mju_sparse2dense(dense, data.M, model.M_rownnz, model.M_rowadr, model.M_colind)
    return dense + np.tril(dense, -1).T


def body_id(compiled: mujoco.MjModel, frame: str) -> int:
    names = [compiled.body(i).name for i in range(compiled.nbody)]
    return next(i for i, name in enumerate(names) if name in (frame, f"tool/{frame}"))


def compare(model: RobotModel, count: int, *, tolerance: float) -> None:
    compiled = mujoco_model(model)
    assert compiled.nv == model.nv
    data = mujoco.MjData(compiled)
    body = body_id(compiled, model.frame)
    q, v = states(model, count)
    generator = np.random.default_rng(1)
    torque, wrench = generator.normal(size=(count, model.nv)), generator.normal(size=(count, 6))
    ours = {
        "M": model.mass_matrix(q),
        "C v + g": np.einsum("nij,nj->ni", model.coriolis_matrix(q, v), v) + model.gravity(q),
        "bias": model.bias(q, v),
        "J": model.jacobian(q),
        "J_dot": model.jacobian_dot(q, v),
        "position": model.pose(q)[:, :3, 3],
        "rotation": model.pose(q)[:, :3, :3],
        "twist": model.twist(q, v),
        "acceleration": model.acceleration(q, v, torque, external_wrench=wrench),
    }
    theirs: dict[str, list[np.ndarray]] = {name: [] for name in ours}
    for i in range(count):
        data.qpos[:], data.qvel[:] = q[i], v[i]
        mujoco.mj_forward(compiled, data)
        jacobian, derivative = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        mujoco.mj_jacBody(compiled, data, jacobian[:3], jacobian[3:], body)
        mujoco.mj_jacDot(compiled, data, derivative[:3], derivative[3:], data.xpos[body], body)
        theirs["M"].append(mass_matrix(compiled, data))
        theirs["C v + g"].append(data.qfrc_bias.copy())
        theirs["bias"].append(data.qfrc_bias.copy())
        theirs["J"].append(jacobian)
        theirs["J_dot"].append(derivative)
        theirs["position"].append(data.xpos[body].copy())
        theirs["rotation"].append(data.xmat[body].reshape(3, 3).copy())
        theirs["twist"].append(jacobian @ v[i])
        data.qfrc_applied[:] = torque[i]
        mujoco.mj_applyFT(
            compiled, data, -wrench[i, :3], -wrench[i, 3:], data.xpos[body], body, data.qfrc_applied
        )
        mujoco.mj_forward(compiled, data)
        theirs["acceleration"].append(data.qacc.copy())
        data.qfrc_applied[:] = 0
    for name, value in ours.items():
        np.testing.assert_allclose(value, theirs[name], atol=tolerance, rtol=0, err_msg=name)


@pytest.mark.parametrize("tool", [None, CUP])
def test_pinocchio_and_mujoco_agree_on_the_lr_mate(tool: str | None):
    compare(robot(FANUC, tool=tool), 1000, tolerance=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_pinocchio_and_mujoco_agree_on_every_arm(name: str):
    bare = robot(name)
    compare(load_robot(name, armature=np.linspace(0.5, 0.1, bare.nv)), 20, tolerance=1e-9)


def test_total_mass_is_the_same_in_mujoco():
    arm = robot(FANUC, tool=CUP)
    total = sum(inertia.mass for inertia in arm.pinocchio.inertias)
    assert mujoco_model(arm).body_mass.sum() == pytest.approx(total, rel=1e-14)


@pytest.mark.parametrize("name", [FANUC, CUP, "peg"])
def test_mujoco_reads_the_urdf_with_its_shapes(name: str):
    folder = robots_directory() / name
    compiled = mujoco.MjSpec.from_file(str(folder / f"{name}.urdf")).compile()
    links = ElementTree.parse(folder / f"{name}.urdf").getroot().findall("link/inertial/mass")
    assert compiled.body_mass.sum() == pytest.approx(sum(float(m.get("value", "nan")) for m in links))
    collides = compiled.geom_contype > 0
    assert collides.any()
    assert (~collides).any()


def test_the_peg_is_the_studied_one():
    compiled = mujoco.MjModel.from_xml_path(str(robots_directory() / "peg" / "peg.urdf"))
    peg = compiled.body("peg")
    np.testing.assert_allclose([peg.mass[0], *peg.inertia], [0.5, 8.2e-4, 8.2e-4, 3e-4])
    assert compiled.geom_size[0, 0] * 2 == pytest.approx(25.37e-3)
    np.testing.assert_allclose(compiled.body("tip").pos, [0, 0, -0.06])


# -------------------------------------------------------------------------------------------- theorems


def rate(function, q: np.ndarray, v: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """d/dt of a function of q along q̇ = v: central differences, extrapolated to fourth order."""

    def central(h: float) -> np.ndarray:
        return (function(q + h * v) - function(q - h * v)) / (2 * h)

    return (4 * central(step / 2) - central(step)) / 3


@pytest.mark.parametrize("name", [FANUC, "panda", "so100"])
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_jacobian_is_the_derivative_of_the_pose(name: str, seed: int):
    model = robot(name)
    (q,), (v,) = states(model, 1, seed=seed)
    pose_rate = rate(model.pose, q, v)
    spin = pose_rate[:3, :3] @ model.pose(q)[:3, :3].T
    angular = [spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(model.twist(q, v), [*pose_rate[:3, 3], *angular], atol=1e-8)
    np.testing.assert_allclose(model.twist(q, v), model.jacobian(q) @ v, atol=1e-13)


@pytest.mark.parametrize("name", [FANUC, "panda"])
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_jacobian_dot_is_the_derivative_of_the_jacobian(name: str, seed: int):
    model = robot(name)
    (q,), (v,) = states(model, 1, seed=seed)
    for frame in (model.frame, model.frame_names[3]):
        expected = rate(lambda x, frame=frame: model.jacobian(x, frame), q, v)
        np.testing.assert_allclose(model.jacobian_dot(q, v, frame), expected, atol=1e-8)


@pytest.mark.parametrize("name", [FANUC, "panda", "kinova"])
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_mass_rate_less_twice_coriolis_is_skew(name: str, seed: int):
    model = robot(name)
    (q,), (v,) = states(model, 1, seed=seed)
    coriolis = model.coriolis_matrix(q, v)
    skewed = rate(model.mass_matrix, q, v) - 2 * coriolis
    np.testing.assert_allclose(skewed, -skewed.T, atol=1e-8)
    np.testing.assert_allclose(coriolis @ v + model.gravity(q), model.bias(q, v), atol=1e-11)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_gravity_is_the_gradient_of_potential_energy(seed: int):
    model = robot(FANUC, tool=CUP)
    (q,), (v,) = states(model, 1, seed=seed)
    data = model.pinocchio.createData()
    power = rate(lambda x: np.array(pin.computePotentialEnergy(model.pinocchio, data, x)), q, v)
    assert model.gravity(q) @ v == pytest.approx(float(power), abs=1e-7)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_armature_adds_to_the_diagonal_of_the_mass_matrix(seed: int):
    (q,), _ = states(robot(FANUC), 1, seed=seed)
    with_rotors, without = robot(FANUC).mass_matrix(q), load_robot(FANUC, armature=np.zeros(6)).mass_matrix(q)
    np.testing.assert_allclose(with_rotors - without, np.diag(robot(FANUC).armature), atol=1e-14)
    assert np.linalg.eigvalsh(with_rotors).min() > 0.05


@pytest.mark.parametrize("name", ARMS)
@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_acceleration_solves_the_equation_of_motion(name: str, seed: int):
    """``M q̈ + C q̇ + g = τ − Jᵀ F_ext``, also for a wrench at another frame."""
    model = robot(name)
    (q,), (v,) = states(model, 1, seed=seed)
    generator = np.random.default_rng(seed)
    torque, wrench = generator.normal(size=model.nv), generator.normal(size=6)
    for frame in (None, model.frame_names[3]):
        acceleration = model.acceleration(q, v, torque, external_wrench=wrench, frame=frame)
        balance = model.mass_matrix(q) @ acceleration + model.bias(q, v) + model.jacobian(q, frame).T @ wrench
        np.testing.assert_allclose(balance, torque, atol=1e-8)


# ----------------------------------------------------------------------------------- operational space


def regular_states(model: RobotModel, count: int, *, seed: int) -> tuple[np.ndarray, np.ndarray]:
    q, v = states(model, 10 * count, seed=seed)
    values = np.linalg.svd(model.jacobian(q), compute_uv=False)[:, -1]
    return q[values > 0.05][:count], v[:count]


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_operational_space_of_six_joints_is_its_definition(seed: int):
    model = robot(FANUC, tool=CUP)
    (q,), (v,) = regular_states(model, 1, seed=seed)
    space = model.operational_space(q, v)
    mass, jacobian = model.mass_matrix(q), model.jacobian(q)
    inverse = np.linalg.inv(jacobian)
    bias_acceleration = model.jacobian_dot(q, v) @ v
    np.testing.assert_allclose(space.mass, inverse.T @ mass @ inverse, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(space.jacobian_inverse, inverse, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(space.gravity, inverse.T @ model.gravity(q), atol=1e-8)
    joint_coriolis = model.coriolis_matrix(q, v) @ v
    expected = inverse.T @ joint_coriolis - space.mass @ bias_acceleration
    np.testing.assert_allclose(space.coriolis, expected, atol=1e-7)
    # the feed-forward for ẍ_d = 0, back in joint space
    torque = jacobian.T @ (space.coriolis + space.gravity)
    wanted = model.bias(q, v) - jacobian.T @ space.mass @ bias_acceleration
    np.testing.assert_allclose(torque, wanted, atol=1e-8)
    assert space.damped is False
    assert space.singular_value == pytest.approx(np.linalg.svd(jacobian)[1][-1])


@pytest.mark.parametrize("name", [FANUC, "panda", "ur5"])
@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_a_wrench_accelerates_the_end_effector_as_the_terms_say(name: str, seed: int):
    """``M(x) ẍ + C ẋ + G = F`` for ``τ = Jᵀ F``, redundant or not, with ẍ from the forward dynamics."""
    model = robot(name)
    (q,), (v,) = regular_states(model, 1, seed=seed)
    force = np.random.default_rng(seed).normal(size=6)
    space = model.operational_space(q, v)
    joint = np.linalg.solve(model.mass_matrix(q), space.jacobian.T @ force - model.bias(q, v))
    acceleration = space.jacobian @ joint + space.jacobian_dot @ v
    np.testing.assert_allclose(
        space.mass @ acceleration + space.coriolis + space.gravity, force, rtol=1e-6, atol=1e-6
    )


def test_operational_space_is_damped_at_a_singularity():
    model = robot(FANUC)
    straight = np.zeros(6)  # axes 4 and 6 in one line
    with pytest.warns(SingularityWarning, match="damped"):
        space = model.operational_space(straight, np.ones(6))
    assert space.damped is True
    assert space.singular_value == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.eigvalsh(space.mass).max() == pytest.approx(1 / SMALLEST_MOBILITY)
    assert np.isfinite(space.coriolis).all()


@pytest.mark.filterwarnings("ignore::vic_toolbox.models.SingularityWarning")
def test_damping_leaves_the_other_directions_exact():
    """Across the wrist singularity, M(x) inverts the mobility except along the one lost direction."""
    model = robot(FANUC)
    q = np.linspace(0.0, 0.2, 401)[:, None] * np.eye(6)[4]
    space = model.operational_space(q, np.zeros(6))
    damped = np.asarray(space.damped)
    assert damped[0]
    assert not damped[-1]
    assert (np.diff(damped.astype(int)) <= 0).all()
    mobility = space.jacobian @ np.linalg.solve(model.mass_matrix(q), np.swapaxes(space.jacobian, -1, -2))
    values, vectors = np.linalg.eigh(mobility)
    heaviest = np.linalg.eigvalsh(space.mass)[:, -1]
    np.testing.assert_allclose(1 / heaviest, np.maximum(values[:, 0], SMALLEST_MOBILITY), rtol=1e-9)
    rest = vectors[:, :, 1:]
    np.testing.assert_allclose(space.mass @ mobility @ rest, rest, atol=1e-8)


def test_an_arm_with_five_joints_is_always_damped():
    model = robot("so100")
    with pytest.warns(SingularityWarning):
        space = model.operational_space(model.home, np.zeros(5))
    assert space.damped
    assert space.singular_value == 0.0


# ------------------------------------------------------------------------------------ batches and input

METHODS = [
    ("mass_matrix", 1),
    ("coriolis_matrix", 2),
    ("gravity", 1),
    ("bias", 2),
    ("jacobian", 1),
    ("jacobian_dot", 2),
    ("pose", 1),
    ("twist", 2),
    ("acceleration", 3),
]


@pytest.mark.parametrize(("method", "arguments"), METHODS)
def test_a_batch_is_its_samples(method: str, arguments: int):
    function = getattr(robot("panda"), method)
    inputs = [*states(robot("panda"), 6), np.random.default_rng(1).normal(size=(6, 7))][:arguments]
    single = np.stack([function(*(x[i] for x in inputs)) for i in range(6)])
    np.testing.assert_array_equal(function(*inputs), single)
    grid = function(*(x.reshape(2, 3, -1) for x in inputs))
    np.testing.assert_array_equal(grid, single.reshape(2, 3, *single.shape[1:]))
    assert function(*(x[:0] for x in inputs)).shape == (0, *single.shape[1:])
    strided = [np.asfortranarray(np.repeat(x, 2, axis=1))[:, ::2] for x in inputs]
    np.testing.assert_array_equal(function(*strided), single)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_operational_space_of_a_batch(batch: tuple[int, ...]):
    model = robot("panda")
    q, v = (x.reshape(*batch, 7) for x in regular_states(model, int(np.prod(batch)), seed=3))
    space = model.operational_space(q, v)
    assert space.mass.shape == (*batch, 6, 6)
    assert space.coriolis.shape == space.gravity.shape == (*batch, 6)
    assert space.jacobian_inverse.shape == (*batch, 7, 6)
    assert np.shape(space.damped) == np.shape(space.singular_value) == batch
    if batch:
        index = tuple(n - 1 for n in batch)
        one = model.operational_space(q[index], v[index])
        np.testing.assert_allclose(space.coriolis[index], one.coriolis, rtol=1e-10)


def test_one_posture_goes_with_many_velocities():
    model = robot(FANUC)
    _, v = states(model, 4)
    assert model.bias(model.home, v).shape == (4, 6)
    assert model.operational_space(model.home, v).mass.shape == (4, 6, 6)
    wrenches = np.random.default_rng(0).normal(size=(3, 6))
    pushed = model.acceleration(model.home, v[0], np.zeros(6), external_wrench=wrenches)
    assert pushed.shape == (3, 6)
    one = model.acceleration(model.home, v[0], np.zeros(6), external_wrench=wrenches[1])
    np.testing.assert_allclose(pushed[1], one, rtol=1e-12)


@pytest.mark.parametrize(("method", "arguments"), METHODS)
@pytest.mark.parametrize(
    "bad", [np.full(6, np.nan), np.zeros(5), np.zeros((6, 1)), "home", None, 1j * np.ones(6)]
)
def test_bad_states_are_refused(method: str, arguments: int, bad):
    function = getattr(robot(FANUC), method)
    for position in range(arguments):
        inputs = [np.zeros(6)] * arguments
        inputs[position] = bad
        with pytest.raises(InputError, match="^" + ("q", "v", "torque")[position]):
            function(*inputs)


def test_batches_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="equal batches"):
        robot(FANUC).bias(np.zeros((2, 6)), np.zeros((3, 6)))
    with pytest.raises(InputError, match=r"external_wrench \(3,\)"):
        robot(FANUC).acceleration(*np.zeros((3, 2, 6)), external_wrench=np.zeros((3, 6)))


@pytest.mark.parametrize("bad", [np.zeros(3), np.full(6, np.inf), "push"])
def test_bad_wrenches_are_refused(bad):
    with pytest.raises(InputError, match="external_wrench"):
        robot(FANUC).acceleration(*np.zeros((3, 6)), external_wrench=bad)
    with pytest.raises(ModelError, match="nose"):
        robot(FANUC).acceleration(*np.zeros((3, 6)), external_wrench=np.zeros(6), frame="nose")


def test_unknown_frames_are_refused_with_the_known_ones():
    for method in ("jacobian", "pose"):
        with pytest.raises(ModelError, match="nose.*tool0"):
            getattr(robot(FANUC), method)(np.zeros(6), "nose")


def test_results_are_fresh_and_attributes_constant():
    model = robot(FANUC)
    first = model.mass_matrix(model.home)
    kept = first.copy()
    model.mass_matrix(np.ones(6))
    np.testing.assert_array_equal(first, kept)
    with pytest.raises(ValueError, match="read-only"):
        model.home[0] = 1.0
