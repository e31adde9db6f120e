"""Learned detection of unseen parts: instance segmentation of the image, then the part of each instance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
