"""The training-free baseline: retrieve the nearest template."""

from simpick.estimators.retrieval.retrieval import RetrievalConfig as RetrievalConfig
from simpick.estimators.retrieval.retrieval import RetrievalEstimator as RetrievalEstimator
