"""`Renderer`: colour, metric depth and geom ids of one MuJoCo model, from its cameras or from any pinhole.

Two passes draw everything: one for colour (anti-aliased, lit, with shadows), and one without anti-aliasing for depth
and ids, whose values are exactly those at the pixels' centres.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from simpick.closing import Closing
from simpick.config import Config, PositiveFloat
from simpick.errors import ConfigError, RenderingUnavailableError, UnknownNameError
from simpick.geometry import Pinhole
from simpick.rendering.gl import make_gl_context
from simpick.rendering.quality import SCENE_QUALITY, RenderQuality

_SHADOW = int(mujoco.mjtRndFlag.mjRND_SHADOW)
_REFLECTION = int(mujoco.mjtRndFlag.mjRND_REFLECTION)
_SKYBOX = int(mujoco.mjtRndFlag.mjRND_SKYBOX)
_SEGMENT = int(mujoco.mjtRndFlag.mjRND_SEGMENT)
_IDCOLOR = int(mujoco.mjtRndFlag.mjRND_IDCOLOR)
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)
# Decoration is of the third category, which no camera sees. Sites count as what they are attached to, so their groups
# are hidden below as well.
_CATEGORIES = int(mujoco.mjtCatBit.mjCAT_STATIC) | int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
_FIRST_HIDDEN_GROUP = 3
MAX_SIDE_PX = 8192
"""Images may not be wider or higher."""


@dataclass(frozen=True, eq=False)
class Viewpoint(Config):
    """A camera that need not be in the model."""

    camera: Pinhole
    """Any focal lengths and principal point."""
    T_world_camera: Float[np.ndarray, "4 4"]
    """OpenCV axes."""
    near_m: PositiveFloat = 0.02
    far_m: float = 10.0
    """What is nearer or farther is cut away."""

    def _check_rules(self) -> None:
        if not self.near_m < self.far_m:
            raise ConfigError(f"near_m must be below far_m, got {self.near_m} and {self.far_m}")


@dataclass(frozen=True, eq=False)
class Rendering:
    """What one call of `Renderer.render` drew; None where it was not asked for."""

    rgb: UInt8[np.ndarray, "height width 3"] | None
    depth_m: Float32[np.ndarray, "height width"] | None
    """Distance along the optical axis in metres; 0 in the background."""
    geoms: Int32[np.ndarray, "height width"] | None
    """MuJoCo's geom id; -1 in the background."""


class Renderer(Closing):
    """Renders one model; the OpenGL context is made by the first `render` and freed by `close`.

    Geom groups 0 to 2 are seen, groups 3 to 5 (collision geometry) and all decoration such as sites are not. Changes
    of the model's values (colours, lights, poses) show in the next image, those of its textures after
    `upload_textures`; another model needs another renderer. Use it from one thread at a time. Any number of renderers
    may live in one process.
    """

    def __init__(
        self, model: mujoco.MjModel, height: int, width: int, *, quality: RenderQuality = SCENE_QUALITY
    ) -> None:
        """Prepare to render images of at most this size.

        Raises:
            ConfigError: the size is not between 1 and `MAX_SIDE_PX`.
        """
        for name, value in (("height", height), ("width", width)):
            if not 1 <= value <= MAX_SIDE_PX:
                raise ConfigError(f"image {name} must be between 1 and {MAX_SIDE_PX} px, got {value}")
        self.model = model
        self.height, self.width = height, width
        self.quality = quality
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = np.arange(len(self._option.geomgroup)) < _FIRST_HIDDEN_GROUP
        for group in (self._option.sitegroup, self._option.tendongroup, self._option.jointgroup):
            group[:] = 0
        self._camera = mujoco.MjvCamera()
        self._gl: Any = None
        self._context: Any = None
        self._scene: Any = None
        self._closed = False

    def render(
        self,
        data: mujoco.MjData,
        camera: str | Viewpoint,
        *,
        rgb: bool = True,
        depth: bool = False,
        geoms: bool = False,
        only: Sequence[int] | None = None,
    ) -> Rendering:
        """Return the image of a camera of the model, at the renderer's size, or of a `Viewpoint`, at its own.

        `data` must hold current kinematics (``mj_kinematics`` and ``mj_camlight``, or ``mj_forward``). With `only`,
        only these geoms are drawn, regardless of their group.

        Raises:
            UnknownNameError: the model has no such camera.
            ConfigError: the viewpoint's image is larger than the renderer's.
            RenderingUnavailableError: OpenGL is missing, or the renderer is closed.
        """
        height, width = self._aim(camera)
        self._make_current()
        self._update(data, only)
        rect = mujoco.MjrRect(0, 0, width, height)
        colour = self._draw_colour(rect) if rgb else None
        metric, ids = self._draw_geometry(rect, depth, geoms) if depth or geoms else (None, None)
        return Rendering(colour, metric, ids)

    def upload_textures(self) -> None:
        """Take over changes of the model's ``tex_data``, which is otherwise read once, by the first `render`."""
        if self._context is not None:
            self._make_current()
            for texture in range(self.model.ntex):
                mujoco.mjr_uploadTexture(self.model, self._context, texture)

    def close(self) -> None:
        """Free the OpenGL context. May be called again; rendering afterwards raises RenderingUnavailableError."""
        self._closed = True
        gl, context = self._gl, self._context
        self._gl = self._context = self._scene = None
        if context is not None:
            with gl.as_current():
                context.free()
        if gl is not None:
            gl.free()

    def __del__(self) -> None:
        # Absent where __init__ raised. The garbage collector may run in another thread than the one that the context is
        # current in: what cannot be freed there, the process frees at its end.
        if getattr(self, "_gl", None) is not None:
            with suppress(Exception):
                self.close()

    # -- passes -------------------------------------------------------------------------------------------------

    def _draw_colour(self, rect: mujoco.MjrRect) -> UInt8[np.ndarray, "height width 3"]:
        flags = self._scene.flags
        flags[[_SEGMENT, _IDCOLOR]] = 0
        flags[[_SKYBOX, _REFLECTION]] = 1
        flags[_SHADOW] = self.quality.shadow_map_px > 0
        pixels = np.empty((rect.height, rect.width, 3), np.uint8)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        # OpenGL's first row is the lowest.
        return np.ascontiguousarray(pixels[::-1])

    def _draw_geometry(
        self, rect: mujoco.MjrRect, depth: bool, geoms: bool
    ) -> tuple[Float32[np.ndarray, "height width"] | None, Int32[np.ndarray, "height width"] | None]:
        flags = self._scene.flags
        # MuJoCo switches multisampling off for this pass; everything is drawn at the pixels' centres.
        flags[[_SEGMENT, _IDCOLOR]] = 1
        flags[[_SHADOW, _SKYBOX, _REFLECTION]] = 0
        colours = np.empty((rect.height, rect.width, 3), np.uint8) if geoms else None
        z_buffer = np.empty((rect.height, rect.width), np.float32) if depth else None
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(colours, z_buffer, rect, self._context)
        metric = None if z_buffer is None else self._metric_depth(z_buffer[::-1])
        ids = None if colours is None else self._geom_ids(colours[::-1])
        return metric, ids

    def _metric_depth(self, z_buffer: Float32[np.ndarray, "height width"]) -> Float32[np.ndarray, "height width"]:
        """Undo the reversed perspective: z_buffer = near (far - z) / (z (far - near)), from 1 (near) to 0 (far)."""
        camera = self._scene.camera[0]
        near, far = float(camera.frustum_near), float(camera.frustum_far)
        # In float32 this costs less than a micrometre at a metre, for the reversed buffer is dense far away.
        z = np.float32(near * far) / (np.float32(near) + z_buffer * np.float32(far - near))
        z[z_buffer == 0] = 0.0
        return z

    def _geom_ids(self, colours: UInt8[np.ndarray, "height width 3"]) -> Int32[np.ndarray, "height width"]:
        # Colour k is what was drawn as the scene's k-th thing, counted from 1; 0 is the background.
        drawn = np.full(self._scene.ngeom + 1, -1, np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == _GEOM:
                drawn[geom.segid + 1] = geom.objid
        index = colours[..., 0]
        if len(drawn) > 256:
            index = index | colours[..., 1].astype(np.int32) << 8 | colours[..., 2].astype(np.int32) << 16
        return drawn.take(index)

    # -- set-up -------------------------------------------------------------------------------------------------

    def _aim(self, camera: str | Viewpoint) -> tuple[int, int]:
        """Point MuJoCo's camera and return height and width of the image."""
        if isinstance(camera, str):
            number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
            if number < 0:
                raise UnknownNameError("camera", camera, [self.model.camera(k).name for k in range(self.model.ncam)])
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = number
            return self.height, self.width
        pinhole = camera.camera
        if pinhole.height > self.height or pinhole.width > self.width:
            raise ConfigError(
                f"a viewpoint's image must fit into the renderer's {self.width} x {self.height} px, "
                f"got {pinhole.width} x {pinhole.height}; make a larger renderer"
            )
        self._make_current()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_USER
        set_gl_cameras(self._scene, camera)
        return pinhole.height, pinhole.width

    def _update(self, data: mujoco.MjData, only: Sequence[int] | None) -> None:
        if only is None:
            mujoco.mjv_updateScene(self.model, data, self._option, None, self._camera, _CATEGORIES, self._scene)
            return
        # MuJoCo selects geoms by their group alone, so groups are lent for one update.
        groups = self.model.geom_group.copy()
        try:
            self.model.geom_group[:] = _FIRST_HIDDEN_GROUP
            self.model.geom_group[list(only)] = 0
            mujoco.mjv_updateScene(self.model, data, self._option, None, self._camera, _CATEGORIES, self._scene)
        finally:
            self.model.geom_group[:] = groups

    def _make_current(self) -> None:
        if self._closed:
            raise RenderingUnavailableError("the renderer is closed; make a new one")
        if self._context is None:
            self._open()
        self._gl.make_current()

    def _open(self) -> None:
        self._gl = make_gl_context(self.width, self.height)
        self._gl.make_current()
        visual = self.model.vis
        # The context copies these on creation; the model is left as it was.
        fields = (
            (visual.global_, "offwidth", self.width),
            (visual.global_, "offheight", self.height),
            (visual.quality, "shadowsize", self.quality.shadow_map_px),
            (visual.quality, "offsamples", self.quality.samples),
        )
        before = [getattr(group, name) for group, name, _ in fields]
        try:
            for group, name, value in fields:
                setattr(group, name, value)
            self._context = mujoco.MjrContext(self.model, int(mujoco.mjtFontScale.mjFONTSCALE_100))
        finally:
            for (group, name, _), value in zip(fields, before, strict=True):
                setattr(group, name, value)
        mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(self.model, self.model.ngeom + 64)


def set_gl_cameras(scene: mujoco.MjvScene, viewpoint: Viewpoint) -> None:
    """Make both of a scene's eyes see what a pinhole sees, principal point and aspect included.

    The frustum is given at the near plane: its top edge is ``cy / fy`` above the axis, and so on.
    """
    pinhole, T = viewpoint.camera, viewpoint.T_world_camera
    near = viewpoint.near_m
    for k in range(2):
        eye = scene.camera[k]
        eye.pos, eye.forward, eye.up = T[:3, 3], T[:3, 2], -T[:3, 1]
        eye.orthographic = 0
        eye.frustum_near, eye.frustum_far = near, viewpoint.far_m
        eye.frustum_top = near * pinhole.cy / pinhole.fy
        eye.frustum_bottom = -near * (pinhole.height - pinhole.cy) / pinhole.fy
        eye.frustum_center = near * (pinhole.width / 2 - pinhole.cx) / pinhole.fx
        eye.frustum_width = near * pinhole.width / 2 / pinhole.fx
