"""Gymnasium environments; ids are registered by ``import simpick``."""

import lazy_loader

import simpick.rendering  # noqa: F401 - checks MUJOCO_GL before the first import of MuJoCo

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
