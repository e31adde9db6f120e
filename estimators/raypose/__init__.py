"""RayPose: 6D poses of unseen parts by bundling rays of template views (Huang et al., ICCV 2025)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
