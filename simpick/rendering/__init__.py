"""Rendering: images of scenes and of single parts, template sets, visibility."""

import lazy_loader

from simpick.rendering.gl import refuse_missing_library, refuse_unknown_backend

# Before the first import of MuJoCo, which fails with an obscure error otherwise.
refuse_unknown_backend()
refuse_missing_library()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
