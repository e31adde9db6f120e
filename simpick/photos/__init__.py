"""The user's own photographs: image and camera files, poses in the frame of the CAD file, overlays and recordings.

`estimate` takes an image, a camera and parts; `PhotoEstimator` keeps what they share from image to image.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
