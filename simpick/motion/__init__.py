"""Motion: inverse kinematics, trajectories, and picks that report what happened and why."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
