"""Grasping: candidates on the CAD, verification in simulation, storage, and the choice of a grasp in the bin."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
