from .confidence import read_confidence as read_confidence
from .config import AlignmentLevel as AlignmentLevel
from .config import RefinerConfig as RefinerConfig
from .refined_estimator import RefinedEstimator as RefinedEstimator
from .refiner import Refiner as Refiner
