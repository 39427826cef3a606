"""The picture of Peg-in-Hole shows what the physics simulates, and touches nothing."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from vic_toolbox.errors import DependencyError
from vic_toolbox.experiments import film as film_module
from vic_toolbox.experiments.trace import record_trace
from vic_toolbox.tasks import peg_scene, rendering
from vic_toolbox.tasks.peg_in_hole import PegInHole
from vic_toolbox.tasks.peg_picture import SEGMENTS, picture_spec, revolve
from vic_toolbox.tasks.peg_scene import CHAMFER, HOLE_RADIUS, PegScenario

SCENARIOS = [PegScenario(), PegScenario(tilt=-6), PegScenario(scale=0.3, clearance=45), PegScenario(scale=3)]


def opengl_works() -> bool:
    try:
        rendering.Renderer(picture_spec(PegScenario()), width=32, height=32).close()
    except DependencyError:
        return False
    return True


needs_opengl = pytest.mark.skipif(not opengl_works(), reason="no OpenGL on this machine")


def vertices(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Vertices of a mesh geom in its body's frame, (v, 3)."""
    geom = model.geom(name)
    mesh = model.mesh(name)
    first, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, geom.quat)
    return model.mesh_vert[first : first + count] @ rotation.reshape(3, 3).T + geom.pos


def pose(tilt: float, tip: tuple[float, float, float], scale: float = 1.0) -> np.ndarray:
    """qpos of a peg with this tilt [deg] whose tip is here [m]."""
    half = np.radians(tilt) / 2
    axis = np.array([np.sin(2 * half), 0.0, np.cos(2 * half)])
    return np.array([*(tip + scale * peg_scene.TIP_DISTANCE * axis), np.cos(half), 0.0, np.sin(half), 0.0])


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_it_moves_as_the_physics_does(scenario: PegScenario) -> None:
    picture, physics = picture_spec(scenario).compile(), peg_scene.physics_model(scenario.geometry)
    assert (picture.nq, picture.njnt) == (physics.nq, physics.njnt) == (7, 1)
    for model in (picture, physics):
        assert model.joint("peg").type == mujoco.mjtJoint.mjJNT_FREE
    np.testing.assert_array_equal(picture.geom("peg").size, physics.geom("peg").size)
    assert picture.body("peg").mass == physics.body("peg").mass


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_the_bore_is_round_and_the_peg_fits(scenario: PegScenario) -> None:
    model, scale = picture_spec(scenario).compile(), scenario.scale
    hole = vertices(model, "hole")
    radius, depth = np.linalg.norm(hole[:, :2], axis=1), -hole[:, 2]
    tolerance = 1e-7 * scale * HOLE_RADIUS  # MuJoCo keeps vertices in single precision
    bore = depth > scale * (CHAMFER - 1e-6)
    inner = radius[bore & (radius < scale * 2 * HOLE_RADIUS)]
    assert inner.size >= SEGMENTS
    np.testing.assert_allclose(inner, scale * HOLE_RADIUS, rtol=0, atol=max(1e-9, 2 * tolerance))
    mouth = radius[(depth < tolerance) & (radius < scale * 2 * HOLE_RADIUS)]
    np.testing.assert_allclose(mouth, scale * (HOLE_RADIUS + CHAMFER), rtol=0, atol=max(1e-9, 2 * tolerance))
    shaft = np.linalg.norm(vertices(model, "shaft")[:, :2], axis=1).max()
    assert shaft == pytest.approx(model.geom("peg").size[0], abs=max(1e-9, 2 * tolerance))
    assert shaft < inner.min() * np.cos(np.pi / SEGMENTS)  # of the chords


def test_the_front_half_of_the_block_is_cut_away() -> None:
    model = picture_spec(PegScenario()).compile()
    assert vertices(model, "hole")[:, 1].min() > -1e-8
    np.testing.assert_allclose(vertices(model, "section")[:, 1], 0.0, atol=1e-8)


def test_nothing_in_it_touches() -> None:
    model = picture_spec(PegScenario()).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = pose(6.0, (5e-3, 0.0, -10e-3))  # deep in the block
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    assert not np.any([model.geom_contype, model.geom_conaffinity])


def test_surfaces_of_revolution_face_outward() -> None:
    """A can of volume π r² h, by the divergence theorem; its normals are those of its faces."""
    surface = revolve([(0, 0), (2, 0), (2, 3), (0, 3)], np.linspace(0.0, 2.0 * np.pi, 2001))
    corners, normals = (surface[key][surface["userface"]] for key in ("uservert", "usernormal"))
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.einsum("fi,fi->", corners.mean(axis=1), areas) / 3 == pytest.approx(12 * np.pi, rel=1e-5)
    solid = np.linalg.norm(areas, axis=1) > 1e-12
    assert (np.einsum("fi,fci->fc", areas, normals)[solid] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(surface["usernormal"], axis=1), 1.0)


@pytest.mark.parametrize(
    ("scenario", "side"),
    [(PegScenario(tilt=-6), 1), (PegScenario(tilt=4), -1), (PegScenario(tilt=0, offset=-0.5), -1)],
)
def test_the_close_up_is_where_the_tip_swings(scenario: PegScenario, side: int) -> None:
    assert picture_spec(scenario).compile().camera(rendering.DETAIL).pos[0] * side > 0.9 * HOLE_RADIUS


@needs_opengl
def test_pictures_show_the_peg_at_any_scale() -> None:
    scales = (0.3, 1.0)
    pictures, details = [], []
    for scale in scales:
        task = PegInHole(scenario=PegScenario(tilt=-6, scale=scale))
        with rendering.Renderer(task.picture_spec(), width=160, height=140) as renderer:
            assert renderer.has_detail
            poses = [pose(-6, (0, 0, 3e-3 * scale), scale), pose(0, (0, 0, -10e-3 * scale), scale)]
            pictures.append([renderer.picture(qpos) for qpos in poses])
            details.append([renderer.picture(qpos, camera=rendering.DETAIL) for qpos in poses])
    above, inside = pictures[1]
    assert (above != inside).any(axis=-1).mean() > 0.1
    assert (details[1][0] != details[1][1]).any(axis=-1).mean() > 0.1
    for small, large in zip(*pictures, strict=True):  # only the ruler differs
        difference = np.abs(small.astype(int) - large.astype(int)).max(axis=-1)
        assert (difference > 8).mean() < 0.02


@needs_opengl
def test_the_film_has_the_close_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film_module, "FPS", 2)
    task = PegInHole()
    caption = film_module.film(
        tmp_path / "film.mp4", {"expert": record_trace(task, task.expert_action)}, task
    )
    assert "edge of the hole" in caption
    assert (tmp_path / "film.mp4").stat().st_size > 5_000
