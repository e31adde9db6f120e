"""`SceneRenderer`: what the cameras of a scene see, as `CameraFrame`s."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float, Int

from simpick.closing import Closing
from simpick.errors import RenderingUnavailableError
from simpick.geometry import Pinhole
from simpick.records import CameraFrame
from simpick.rendering.quality import SCENE_QUALITY, RenderQuality
from simpick.rendering.renderer import Renderer, Viewpoint


@runtime_checkable
class RenderableScene(Protocol):
    """What is needed of a scene; `simpick.scene.Scene` has it."""

    model: mujoco.MjModel
    data: mujoco.MjData
    instance_of_geom: Int[np.ndarray, "geoms"]
    """Instance number of each geom; -1 for everything that is no part."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras."""
        ...

    def camera(self, name: str) -> tuple[Pinhole, Float[np.ndarray, "4 4"]]:
        """Return a camera's intrinsics and T_world_camera."""
        ...


class SceneRenderer(Closing):
    """Renders a scene's cameras, each at its own size, through one OpenGL context. Lazy and closable like `Renderer`.

    It follows the scene: when ``scene.model`` is replaced, the context is made again.
    """

    def __init__(self, scene: RenderableScene, *, quality: RenderQuality = SCENE_QUALITY) -> None:
        self.scene = scene
        self.quality = quality
        self._renderer: Renderer | None = None
        self._closed = False

    def capture(
        self, camera: str | Viewpoint = "overhead", *, rgb: bool = True, depth: bool = True, instances: bool = True
    ) -> CameraFrame:
        """Return the image of a camera of the scene, or of one anywhere.

        Without `rgb` the colour image is black and costs nothing. A viewpoint's image may not be larger than the
        largest of the scene's cameras.

        Raises:
            UnknownNameError: the scene has no such camera.
            RenderingUnavailableError: OpenGL is missing, or this is closed.
        """
        viewpoint = camera if isinstance(camera, Viewpoint) else Viewpoint(*self.scene.camera(camera))
        pinhole, T_world_camera = viewpoint.camera, viewpoint.T_world_camera
        image = self.renderer.render(self.scene.data, viewpoint, rgb=rgb, depth=depth, geoms=instances)
        colour = np.zeros((pinhole.height, pinhole.width, 3), np.uint8) if image.rgb is None else image.rgb
        ids = None
        if image.geoms is not None:
            # The last entry is that of geom id -1, the background.
            ids = np.append(self.scene.instance_of_geom, -1).astype(np.int32).take(image.geoms)
        return CameraFrame(colour, pinhole, T_world_camera, image.depth_m, ids)

    @property
    def renderer(self) -> Renderer:
        """Return the renderer of the scene's present model, large enough for each of its cameras."""
        if self._closed:
            raise RenderingUnavailableError("the scene's renderer is closed; make a new one")
        if self._renderer is None or self._renderer.model is not self.scene.model:
            if self._renderer is not None:
                self._renderer.close()
            pinholes = [self.scene.camera(name)[0] for name in self.scene.cameras]
            height, width = max(p.height for p in pinholes), max(p.width for p in pinholes)
            self._renderer = Renderer(self.scene.model, height, width, quality=self.quality)
        return self._renderer

    def close(self) -> None:
        """Free the OpenGL context; may be called again."""
        self._closed = True
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
