"""The refiner: render and compare, without training."""

from simpick.estimators.refiner.confidence import read_confidence as read_confidence
from simpick.estimators.refiner.config import AlignmentLevel as AlignmentLevel
from simpick.estimators.refiner.config import RefinerConfig as RefinerConfig
from simpick.estimators.refiner.refined_estimator import RefinedEstimator as RefinedEstimator
from simpick.estimators.refiner.refiner import Refiner as Refiner
