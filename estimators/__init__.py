"""Detectors and pose estimators."""

from .base import Detector as Detector
from .base import PoseEstimator as PoseEstimator
