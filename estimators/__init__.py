"""Detectors and pose estimators."""

from simpick.estimators.base import BatchPoseEstimator as BatchPoseEstimator
from simpick.estimators.base import Detector as Detector
from simpick.estimators.base import PoseEstimator as PoseEstimator
from simpick.estimators.base import PoseRefiner as PoseRefiner
from simpick.estimators.base import estimate_frames as estimate_frames
