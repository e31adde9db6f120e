"""Grippers: a two-finger parallel jaw and a suction head, both on MuJoCo primitives and both behind one protocol."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
