"""Offscreen rendering with MuJoCo: colour, depth and the object behind every pixel."""

import ctypes
import importlib
import os
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel

LIBRARIES = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}
OPTICAL_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
"""MuJoCo's cameras look along -z with y up, optical frames along +z with y down."""


class RenderingError(InputError):
    """Raised where neither EGL nor OSMesa works: the user's to mend, hence one line and no traceback."""


@dataclass(frozen=True)
class Rendering:
    """One view of a scene."""

    image: NDArray[np.uint8]  # (height, width, 3) RGB
    depth_m: NDArray[np.float32]  # (height, width) along the optical axis, NaN in the sky
    body_ids: NDArray[np.int32]  # (height, width) MuJoCo body, 0 for the room and the background


def choose_library() -> str:
    """Set MUJOCO_GL, unless the user did, to the first offscreen library that loads; raises RenderingError."""
    if os.environ.get("MUJOCO_GL"):
        return os.environ["MUJOCO_GL"]
    for name, library in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["MUJOCO_GL"] = name
        return name
    raise RenderingError("neither libEGL nor libOSMesa loads; install libegl1 and libgl1-mesa-dri, or libosmesa6")


def _context_class(library: str) -> Any:
    """MuJoCo's OpenGL context of that library; ``mujoco.GLContext`` is fixed when mujoco is first imported."""
    if library in LIBRARIES:
        return importlib.import_module(f"mujoco.{library}").GLContext
    return importlib.import_module("mujoco").GLContext


def camera_model(width: int, height: int, horizontal_fov_rad: float) -> CameraModel:
    """A pinhole camera with square pixels whose optical axis meets the middle of the image."""
    focal = width / 2.0 / np.tan(horizontal_fov_rad / 2.0)
    return CameraModel(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)


class Renderer:
    """Renders one MuJoCo scene; a context manager, because OpenGL contexts are scarce."""

    def __init__(self, xml: str, assets: dict[str, bytes], camera: CameraModel) -> None:
        library = choose_library()
        import mujoco

        self._mujoco: Any = mujoco
        self._camera = camera
        try:
            self._gl = _context_class(library)(camera.width, camera.height)
            self._gl.make_current()
        except Exception as fault:  # each library fails in its own way
            raise RenderingError(
                f"no OpenGL context ({fault!r}); install libegl1 and libgl1-mesa-dri, or libosmesa6"
            ) from None
        self._model = mujoco.MjModel.from_xml_string(xml, assets)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = camera.width, camera.height
        self._model.cam_fovy[0] = np.rad2deg(2.0 * np.arctan(camera.height / 2.0 / camera.fy))
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=1000)
        self._option = mujoco.MjvOption()
        self._rectangle = mujoco.MjrRect(0, 0, camera.width, camera.height)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._context.free()
        self._gl.free()

    def render(self, T_world_camera: Array) -> Rendering:
        """The view of an optical frame at the (4, 4) pose ``T_world_camera``."""
        self._place_camera(T_world_camera)
        image = self._draw(segment=False)
        depth = np.empty(image.shape[:2], dtype=np.float32)
        codes = self._draw(segment=True, depth=depth)  # without smoothed edges: this depth belongs to these ids
        return Rendering(image, self._metric(depth[::-1]), self._bodies(codes))

    def _place_camera(self, T_world_camera: Array) -> None:
        mujoco = self._mujoco
        rotation = (T_world_camera[:3, :3] @ OPTICAL_FROM_OPENGL).ravel()
        mujoco.mju_mat2Quat(self._model.cam_quat[0], rotation)
        self._model.cam_pos[0] = T_world_camera[:3, 3]
        mujoco.mj_forward(self._model, self._data)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = 0
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, camera, every, self._scene)

    def _draw(self, segment: bool, depth: NDArray[np.float32] | None = None) -> NDArray[np.uint8]:
        """The picture, upright, or the codes of a segmentation; ``depth`` is filled upside down."""
        flags = self._mujoco.mjtRndFlag
        self._scene.flags[flags.mjRND_SEGMENT] = segment
        self._scene.flags[flags.mjRND_IDCOLOR] = segment
        self._scene.flags[flags.mjRND_SHADOW] = not segment
        image = np.empty((self._camera.height, self._camera.width, 3), dtype=np.uint8)
        self._mujoco.mjr_render(self._rectangle, self._scene, self._context)
        self._mujoco.mjr_readPixels(image, depth, self._rectangle, self._context)
        return image[::-1]

    def _metric(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Metres from the depth buffer (reversed perspective: near is 1, far 0), NaN where nothing was drawn."""
        near = self._model.vis.map.znear * self._model.stat.extent
        far = self._model.vis.map.zfar * self._model.stat.extent
        metres = near * far / (near + depth.astype(np.float64) * (far - near))
        return np.where(depth > 0.0, metres, np.nan).astype(np.float32)

    def _bodies(self, codes: NDArray[np.uint8]) -> NDArray[np.int32]:
        """Bodies from the colours of a segmentation image: the number of a drawn geom plus one, 0 for nothing."""
        body_of_code = np.zeros(self._scene.ngeom + 1, dtype=np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == self._mujoco.mjtObj.mjOBJ_GEOM:
                body_of_code[geom.segid + 1] = self._model.geom_bodyid[geom.objid]
        code = codes[..., 0] + 256 * codes[..., 1].astype(np.uint16)  # a scene has far fewer than 65536 geoms
        return np.asarray(body_of_code[code], dtype=np.int32)
