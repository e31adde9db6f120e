"""Rendering: images of scenes and of single parts, template sets, visibility."""

# ruff: noqa: E402
from simpick.rendering.gl import refuse_unknown_backend as refuse_unknown_backend
from simpick.rendering.gl import select_gl_backend as select_gl_backend

# Before the first import of MuJoCo below, which ends in an obscure error otherwise.
refuse_unknown_backend()

from simpick.rendering.part_views import PartRenderer as PartRenderer
from simpick.rendering.part_views import PartViews as PartViews
from simpick.rendering.part_views import render_part_views as render_part_views
from simpick.rendering.renderer import Renderer as Renderer
from simpick.rendering.renderer import Rendering as Rendering
from simpick.rendering.renderer import RenderQuality as RenderQuality
from simpick.rendering.renderer import Viewpoint as Viewpoint
from simpick.rendering.scene_renderer import SceneRenderer as SceneRenderer
from simpick.rendering.template_sheet import template_sheet as template_sheet
from simpick.rendering.templates import TemplateConfig as TemplateConfig
from simpick.rendering.templates import TemplateSet as TemplateSet
from simpick.rendering.templates import load_templates as load_templates
from simpick.rendering.templates import render_templates as render_templates
from simpick.rendering.templates import template_path as template_path
from simpick.rendering.view_sphere import look_at_part as look_at_part
from simpick.rendering.view_sphere import turn_in_plane as turn_in_plane
from simpick.rendering.view_sphere import view_directions as view_directions
from simpick.rendering.visibility import Visibility as Visibility
from simpick.rendering.visibility import measure_instance as measure_instance
from simpick.rendering.visibility import measure_visibility as measure_visibility
from simpick.rendering.visibility import visible_fractions as visible_fractions
