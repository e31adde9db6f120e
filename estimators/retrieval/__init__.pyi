from .retrieval import RetrievalConfig as RetrievalConfig
from .retrieval import RetrievalEstimator as RetrievalEstimator
