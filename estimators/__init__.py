"""Detectors and pose estimators."""

from simpick.estimators.base import Detector as Detector
from simpick.estimators.base import PoseEstimator as PoseEstimator
