"""Images of one part alone, lit from the camera: templates, the refiner's renderings, depth for VSD."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.mjcf import add_face_colours, add_part
from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.geometry import Pinhole, invert
from simpick.rendering.part_depth import PartViews
from simpick.rendering.quality import PART_QUALITY, RenderQuality
from simpick.rendering.renderer import Renderer, Viewpoint

_EXPOSED_PERCENTILE = 95
_AMBIENT, _DIFFUSE, _EXPOSURE = 0.25, 0.75, 0.85
# Wide, because the reversed z-buffer loses no precision by it.
_NEAR_M, _FAR_M = 0.01, 100.0


class PartRenderer(Closing):
    """Renders one part in any pose through any pinhole. Lazy and closable like `Renderer`.

    The only light sits in the camera and shines along its axis, without shadows or highlights. So shading depends on
    the angle between surface and axis alone, and turning the camera about its axis turns the image and changes
    nothing else. Colours keep the part's hue, at the exposure at which its brightest channel is nearly full, so that
    the shape of a black part shows as well as that of a white one. Parts with `Part.face_rgb` show those colours.
    """

    gives_colours = True

    def __init__(
        self, part: Part, height: int, width: int, *, quality: RenderQuality = PART_QUALITY, shaded: bool = True
    ) -> None:
        """Prepare to render images of at most this size; not `shaded`, they show the colours of the surface alone."""
        self.part = part
        model = _part_model(part, shaded)
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._renderer = Renderer(model, height, width, quality=quality)

    def render(
        self,
        Ts_camera_part: Float[np.ndarray, "n 4 4"],
        cameras: Pinhole | Sequence[Pinhole],
        *,
        rgb: bool = True,
        progress: Callable[[int, int], None] | None = None,
    ) -> PartViews:
        """Return one image for each pose, through one camera or through one each, all of the same size.

        `progress` is called with how many of how many images are done.

        Raises:
            ConfigError: there are not as many cameras as poses, their sizes differ or exceed the renderer's, or a
                pose has the part's origin behind the camera.
        """
        n = len(Ts_camera_part)
        pinholes = [cameras] * n if isinstance(cameras, Pinhole) else list(cameras)
        sizes = {(pinhole.height, pinhole.width) for pinhole in pinholes}
        if len(pinholes) != n:
            raise ConfigError(f"there must be one camera for each pose, got {len(pinholes)} cameras for {n} poses")
        if len(sizes) > 1:
            raise ConfigError(f"cameras of one batch must have one image size, got {sorted(sizes)} (height, width)")
        if n and not (Ts_camera_part[:, 2, 3] > 0).all():
            k = int(np.argmin(Ts_camera_part[:, 2, 3]))
            raise ConfigError(f"parts must be in front of the camera, got z = {Ts_camera_part[k, 2, 3]} m in pose {k}")
        height, width = sizes.pop() if sizes else (self._renderer.height, self._renderer.width)
        colours = np.empty((n, height, width, 3), np.uint8) if rgb else None
        depth_m = np.empty((n, height, width), np.float32)
        # The part stays at the world's origin and the camera moves about it.
        for k, (T_part_camera, pinhole) in enumerate(zip(invert(Ts_camera_part), pinholes, strict=True)):
            viewpoint = Viewpoint(pinhole, T_part_camera, _NEAR_M, _FAR_M)
            image = self._renderer.render(self._data, viewpoint, rgb=rgb, depth=True)
            assert image.depth_m is not None
            depth_m[k] = image.depth_m
            if colours is not None and image.rgb is not None:
                colours[k] = image.rgb
            if progress is not None:
                progress(k + 1, n)
        return PartViews(colours, depth_m)

    def close(self) -> None:
        """Free the OpenGL context; may be called again."""
        self._renderer.close()


def render_part_views(
    part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"], camera: Pinhole, *, rgb: bool = True
) -> PartViews:
    """Return one image per pose; `PartRenderer` keeps what this function sets up on every call."""
    with PartRenderer(part, camera.height, camera.width) as renderer:
        return renderer.render(Ts_camera_part, camera, rgb=rgb)


def _part_model(part: Part, shaded: bool) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    coloured = part.face_rgb is not None
    colour = np.array(part.material.rgb) if part.face_rgb is None else np.ones(3)
    brightest = max(float(colour.max()), 1e-3)
    exposed = _EXPOSURE * colour / brightest if colour.max() >= 1e-3 else np.full(3, _EXPOSURE)
    material = spec.add_material(name="exposed", rgba=[*exposed, 1.0], specular=0.0, shininess=0.0, reflectance=0.0)
    if part.face_rgb is not None:
        scale = 255 / max(float(np.percentile(part.face_rgb.max(axis=1), _EXPOSED_PERCENTILE)), 1.0)
        faces = np.minimum(part.face_rgb * scale, 255).astype(np.uint8)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = add_face_colours(spec, "colours", faces)
    add_part(spec, part, "part", free=False, collide=False, material="exposed", colour_faces=coloured)
    head = spec.visual.headlight
    ambient, diffuse = (_AMBIENT, _DIFFUSE) if shaded else (1.0, 0.0)
    head.ambient, head.diffuse, head.specular = [ambient] * 3, [diffuse] * 3, [0.0] * 3
    return spec.compile()
