"""What a scene is made of: parts, bins, robots, grippers and shipped weights."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
