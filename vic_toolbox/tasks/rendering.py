"""Pictures, films and a live window of a simulation.

Drawing has its own model, with all shapes, floor and lights; it needs joint positions only and cannot disturb
the physics. Off screen it works with whatever OpenGL there is: a display, EGL (no display needed) or
OSMesa (no GPU either).
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import DependencyError, InputError, finite_array, finite_number, integer
from vic_toolbox.files import atomic_path

CAMERA, DETAIL = "overview", "detail"
"""Names of cameras: the one of every scene, and the one that looks from close by, where a scene needs it."""

WOOD = (0.80, 0.70, 0.57, 1.0)
"""Colour of a table."""

_FLOOR = -0.72  # height of the floor below the table's top [m]
_REMEDY = (
    "On Linux: apt-get install libegl1 libgl1 (or libosmesa6), and leave MUJOCO_GL unset: what is there is "
    "found. Everything but pictures works without."
)


def decorate(spec: mujoco.MjSpec, *, table: str) -> mujoco.MjSpec:
    """Add a floor, legs under the table, sky, lights, materials and a camera to a scene; returns it.

    Parameters
    ----------
    spec : mujoco.MjSpec
        Scene; it is changed.
    table : str
        Name of the box that is the table's top.
    """
    world, geom = spec.worldbody, mujoco.mjtGeom
    studio(spec)
    add_tiles(spec)
    spec.add_material(name="wood", rgba=WOOD, specular=0.2, shininess=0.3)
    spec.add_material(name="steel", rgba=[0.30, 0.32, 0.35, 1], specular=0.5, shininess=0.6)
    world.add_geom(
        type=geom.mjGEOM_PLANE,
        size=[4, 4, 0.1],
        pos=[0, 0, _FLOOR],
        material="tiles",
        contype=0,
        conaffinity=0,
    )
    top = spec.geom(table)
    top.material = "wood"
    bottom = top.pos[2] - top.size[2]
    for x in (-1, 1):
        for y in (-1, 1):
            corner = top.pos[:2] + np.array([x, y]) * (top.size[:2] - 0.05)
            world.add_geom(
                type=geom.mjGEOM_BOX, pos=[*corner, (bottom + _FLOOR) / 2],
                size=[0.025, 0.025, (bottom - _FLOOR) / 2], material="steel", contype=0, conaffinity=0,
            )  # fmt: skip
    add_camera(spec, CAMERA, eye=(1.85, -0.75, 1.05), target=(0.22, 0.06, 0.30), fovy=40)
    return spec


def studio(spec: mujoco.MjSpec, *, size: float = 1.0) -> None:
    """Add sky and lights to a scene, and fit what depends on its size.

    Parameters
    ----------
    spec : mujoco.MjSpec
        Scene, around the world's origin; it is changed.
    size : float
        Width of what there is to see [m].
    """
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 3840, 2160
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 2048, 4  # tolerable without a GPU
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.42] * 3, [0.28] * 3
    spec.visual.headlight.specular = [0.05] * 3
    # what shadows and clipping planes are fitted to
    spec.stat.center, spec.stat.extent = size * np.array([0.3, 0.0, 0.3]), 1.1 * size
    spec.visual.map.znear, spec.visual.map.zfar, spec.visual.map.shadowclip = 0.02, 20.0, 1.0
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=512, height=3072, rgb1=[0.88, 0.91, 0.95], rgb2=[0.62, 0.68, 0.76],
    )  # fmt: skip
    sun = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL}
    spec.worldbody.add_light(
        **sun, pos=size * np.array([1.0, -1.0, 2.0]), dir=[-0.35, 0.4, -1], castshadow=True,
        diffuse=[0.5] * 3, specular=[0.2] * 3,
    )  # fmt: skip
    spec.worldbody.add_light(
        **sun, pos=size * np.array([-1.0, 1.5, 2.0]), dir=[0.6, -0.5, -1], castshadow=False,
        diffuse=[0.18] * 3, specular=[0] * 3,
    )  # fmt: skip


def add_tiles(spec: mujoco.MjSpec) -> None:
    """Add the material ``tiles`` of the floor."""
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        width=512, height=512, rgb1=[0.78, 0.79, 0.80], rgb2=[0.75, 0.76, 0.77],
        mark=mujoco.mjtMark.mjMARK_EDGE, markrgb=[0.68, 0.69, 0.70],
    )  # fmt: skip
    tiles = spec.add_material(name="tiles", texuniform=True, texrepeat=[1.5, 1.5])
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"


def add_camera(spec: mujoco.MjSpec, name: str, *, eye: ArrayLike, target: ArrayLike, fovy: float) -> None:
    """Add a camera at `eye` that looks at `target` [m], `fovy` degrees of height in view."""
    position = np.asarray(eye, dtype=np.float64)
    spec.worldbody.add_camera(name=name, pos=position, quat=_look_at(position, np.asarray(target)), fovy=fovy)


def _look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Quaternion (w, x, y, z) of a camera, which looks along its −z axis with y up."""
    backward = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.column_stack([right, np.cross(backward, right), backward]).ravel())
    return quat


class Renderer:
    """Draws a scene at given joint positions, off screen.

    Parameters
    ----------
    spec : mujoco.MjSpec
        Scene with lights and a camera :data:`CAMERA`, see :func:`studio` and :func:`add_camera`.
    width, height : int
        Size of a picture [pixels]; even, for films.

    Raises
    ------
    DependencyError
        There is no OpenGL on this machine; the message says what to install.
    """

    def __init__(self, spec: mujoco.MjSpec, *, width: int = 960, height: int = 544) -> None:
        self._context: Any = None  # first, so that closing is safe if the rest fails
        self.width, self.height = (
            integer(name, n, low=16, high=limit)
            for name, n, limit in (("width", width, 3840), ("height", height, 2160))
        )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._gl = _gl_context(self.width, self.height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(self.model, maxgeom=1000)
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._options.sitegroup[:] = 0
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    @property
    def has_detail(self) -> bool:
        """Whether there is a camera :data:`DETAIL`."""
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, DETAIL) >= 0

    def picture(self, qpos: ArrayLike, *, camera: str = CAMERA) -> np.ndarray:
        """The scene at joint positions (nq,) [m, rad], as (height, width, 3) uint8."""
        if self._context is None:
            raise InputError("this renderer is closed; make a new one.")
        self.data.qpos[:] = finite_array("qpos", qpos, shape=(self.model.nq,))
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._camera.fixedcamid = self.model.camera(camera).id
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self.model, self.data, self._options, None, self._camera, everything, self._scene
        )
        viewport = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        pixels = np.empty((self.height, self.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, viewport, self._context)
        return pixels[::-1].copy()  # OpenGL's rows run upward

    def close(self) -> None:
        """Free the graphics memory; closing twice does no harm."""
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._context = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()


def _gl_context(width: int, height: int) -> Any:
    """An OpenGL context of the first kind that works, or of the one that MUJOCO_GL names."""
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    has_display = sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    native = {"darwin": ["cgl"], "linux": ["egl", "osmesa"]}.get(sys.platform, [])
    kinds = [wanted] if wanted in ("egl", "osmesa", "glfw", "cgl") else native + ["glfw"] * has_display
    platform, failures = os.environ.get("PYOPENGL_PLATFORM"), []
    for kind in kinds:
        try:
            context = importlib.import_module(f"mujoco.{kind}").GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # each kind fails in its own way: a missing library, driver or display
            failures.append(f"{kind}: {error}")
            _restore("PYOPENGL_PLATFORM", platform)
    raise DependencyError(f"no OpenGL to draw with ({'; '.join(failures)}). {_REMEDY}")


def _restore(variable: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(variable, None)
    else:
        os.environ[variable] = value


class Window:
    """A live window that follows the simulation in real time.

    Parameters
    ----------
    spec : mujoco.MjSpec
        As for a :class:`Renderer`.
    period : float
        Time between two calls of :meth:`show` [s].

    Raises
    ------
    DependencyError
        There is no display.
    """

    def __init__(self, spec: mujoco.MjSpec, *, period: float) -> None:
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise DependencyError(
                "there is no display for a window; use render_mode='rgb_array' or write a film instead."
            )
        try:
            viewer, glfw = importlib.import_module("mujoco.viewer"), importlib.import_module("glfw")
            if not glfw.init():  # the viewer would wait for its window for ever
                raise RuntimeError("GLFW does not start")
            self.model = spec.compile()
            self.data = mujoco.MjData(self.model)
            self._handle = viewer.launch_passive(
                self.model, self.data, show_left_ui=False, show_right_ui=False
            )
        except (ImportError, RuntimeError) as error:
            raise DependencyError(f"the window cannot be opened ({error}). {_REMEDY}") from error
        self._period = period
        self._due = time.monotonic()
        with self._handle.lock():
            self._handle.cam.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._handle.cam.fixedcamid = self.model.camera(CAMERA).id

    def show(self, qpos: ArrayLike) -> None:
        """Draw the scene at joint positions (nq,) [m, rad], not sooner than one period after the last call."""
        with self._handle.lock():
            self.data.qpos[:] = finite_array("qpos", qpos, shape=(self.model.nq,))
            mujoco.mj_forward(self.model, self.data)
        self._handle.sync()
        self._due = max(self._due + self._period, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))

    def close(self) -> None:
        """Close the window."""
        self._handle.close()


def write_video(path: str | os.PathLike[str], pictures: Iterable[np.ndarray], *, fps: float = 50.0) -> None:
    """Write pictures (height, width, 3) uint8 as an H.264 film (``.mp4``), which appears when it is whole.

    Raises
    ------
    InputError
        No pictures, pictures of different sizes or of odd size, or a name that does not end in ``.mp4``.
    DependencyError
        imageio-ffmpeg is not installed.
    FileError
        The file cannot be written.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise DependencyError("films need imageio-ffmpeg: pip install 'vic-toolbox[learn]'.") from error
    fps = finite_number("fps", fps, low=1.0, high=240.0)
    if Path(path).suffix != ".mp4":
        raise InputError(f"the film's name is {str(path)!r}; it must end in .mp4.")
    with atomic_path(path) as temporary:
        film, size = None, None
        try:
            for picture in pictures:
                if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
                    raise InputError(
                        f"a picture is {picture.dtype} {picture.shape}; pass uint8 (height, width, 3)."
                    )
                if film is None:
                    size = picture.shape
                    film = _start_film(imageio_ffmpeg, temporary, size, fps)
                if picture.shape != size:
                    raise InputError(
                        f"a picture has shape {picture.shape}, the first one {size}; keep one size."
                    )
                film.send(np.ascontiguousarray(picture))
        finally:
            if film is not None:
                film.close()
        if film is None:
            raise InputError("there are no pictures to write; pass at least one.")


def _start_film(imageio_ffmpeg: Any, path: Path, size: tuple[int, ...], fps: float) -> Any:
    height, width = size[:2]
    if height % 2 or width % 2:
        raise InputError(f"pictures are {width} x {height} pixels; H.264 needs even sizes.")
    film = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,
        codec="libx264",
        quality=8,
        macro_block_size=2,
        ffmpeg_log_level="error",
    )
    film.send(None)
    return film
