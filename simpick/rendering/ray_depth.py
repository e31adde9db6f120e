"""Depth of single parts by ray casting on the CPU (Embree), for machines without OpenGL."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec

import numpy as np
from jaxtyping import Float, Float32

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.errors import ConfigError, RenderingUnavailableError
from simpick.geometry import Pinhole, invert
from simpick.rendering.gl import select_gl_backend
from simpick.rendering.mujoco_presence import required_mujoco
from simpick.rendering.part_depth import PartViews

_INSTALL = "or install Embree, which needs no OpenGL to compute depth: pip install embreex"


@cache
def depth_needs_rays() -> bool:
    """Return whether depth is to be computed by ray casting: OpenGL or MuJoCo is missing here, and Embree installed.

    Raises:
        RenderingUnavailableError: neither is there.
    """
    try:
        select_gl_backend()
        required_mujoco("rendering by OpenGL")
    except RenderingUnavailableError as error:
        if find_spec("embreex") is None:
            raise RenderingUnavailableError(f"{error} {_INSTALL}") from error
        return True
    return False


class RayDepthRenderer(Closing):
    """Computes depth at pixel centres, as `PartRenderer` does, but no colours."""

    gives_colours = False

    def __init__(self, part: Part) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.part = part
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.asarray(part.mesh.triangles, np.float32))

    def render(
        self,
        Ts_camera_part: Float[np.ndarray, "n 4 4"],
        cameras: Pinhole | Sequence[Pinhole],
        *,
        rgb: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> PartViews:
        """Return one depth image for each pose, through one camera or through one each, all of the same size.

        Raises:
            ConfigError: there are not as many cameras as poses.
            RenderingUnavailableError: colours are asked for.
        """
        if rgb:
            raise RenderingUnavailableError("rays give depth only; colours need OpenGL")
        n = len(Ts_camera_part)
        pinholes = [cameras] * n if isinstance(cameras, Pinhole) else list(cameras)
        if len(pinholes) != n:
            raise ConfigError(f"there must be one camera for each pose, got {len(pinholes)} cameras for {n} poses")
        depth_m = (
            np.zeros((n, pinholes[0].height, pinholes[0].width), np.float32) if n else np.zeros((0, 1, 1), np.float32)
        )
        for k, (T_part_camera, pinhole) in enumerate(zip(invert(Ts_camera_part), pinholes, strict=True)):
            depth_m[k] = self._cast(T_part_camera, pinhole)
            if progress is not None:
                progress(k + 1, n)
        return PartViews(None, depth_m)

    def close(self) -> None:
        """Do nothing: rays hold memory only."""

    def _cast(self, T_part_camera: Float[np.ndarray, "4 4"], camera: Pinhole) -> Float32[np.ndarray, "height width"]:
        # Directions have length 1 along the optical axis, so that distances along them are depths.
        directions = (camera.rays() @ T_part_camera[:3, :3].T).reshape(-1, 3).astype(np.float32)
        origins = np.broadcast_to(T_part_camera[:3, 3].astype(np.float32), directions.shape)
        depth_m = self._scene.run(np.ascontiguousarray(origins), directions, query="DISTANCE")
        return np.where(depth_m < 1e6, depth_m, 0).astype(np.float32).reshape(camera.height, camera.width)
