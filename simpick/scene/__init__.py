"""Scenes: composition of the cell, physics, filling the bin, and the truth about it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
