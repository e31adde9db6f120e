"""Rendering: images of scenes and of single parts, template sets, visibility."""

from simpick.rendering.gl import requested_backend as requested_backend
from simpick.rendering.gl import select_gl_backend as select_gl_backend
from simpick.rendering.renderer import Renderer as Renderer
from simpick.rendering.renderer import Rendering as Rendering
from simpick.rendering.renderer import RenderQuality as RenderQuality
from simpick.rendering.renderer import Viewpoint as Viewpoint
from simpick.rendering.scene_renderer import SceneRenderer as SceneRenderer
