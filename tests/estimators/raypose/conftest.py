"""Rendered templates of small parts."""

import pytest

from simpick.assets.part import Part
from simpick.rendering import TemplateConfig, TemplateSet
from simpick.rendering.templates import render_templates
from tests.rendering.conftest import wedge as wedge


@pytest.fixture(scope="session")
def templates(wedge: Part) -> TemplateSet:
    return render_templates(wedge, TemplateConfig(views=42, size_px=96))
