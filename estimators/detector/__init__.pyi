from .detector import AlikePartsWarning as AlikePartsWarning
from .detector import LearnedDetector as LearnedDetector
from .detector import LearnedDetectorConfig as LearnedDetectorConfig
from .segmenter import InstanceSegmenter as InstanceSegmenter
