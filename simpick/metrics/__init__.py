"""Pose errors and scores as BOP defines them, with summaries and confidence intervals.

The public names stand in ``__init__.pyi``. Their modules load on first use, so that importing the package loads
neither SciPy nor trimesh.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
