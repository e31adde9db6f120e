"""Evaluation of pose estimators: the pose benchmark's fixed bins, new bins, BOP data sets, tables.

Images with detections and true poses (`PoseImage`) go through a source of estimates (`PoseSource`, `answers`) to their
errors (`PoseEvaluator.score`) and their summary (`PoseEvaluation`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
