"""From how well a refined pose fits to the probability that it is good enough to pick by.

A logistic regression, fitted on bins of random training parts by ``simpick refiner calibrate``, which writes it with
what it was fitted on; what it wrote lies here as ``confidence.json``. Library parts and user CAD have no part in it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.records import PoseHypothesis

SHIPPED_FILE = Path(__file__).with_name("confidence.json")
FEATURES = ("log_score", "margin", "log_visible_px")
GOOD_MM, GOOD_DEG = 5.0, 10.0
"""A pose is good enough below these errors: there the jaw forgives nearly everything (``simpick sweep``)."""
_WIDEST_MARGIN = 1.0


@dataclass(frozen=True)
class Confidence:
    """A logistic model: ``p = 1 / (1 + exp(-(bias + weights . features)))``."""

    bias: float
    weights: tuple[float, ...]
    """One for each of `FEATURES`."""

    def probability(self, features: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Return the probability that a pose with these features is good."""
        # An array also for a single pose, where NumPy would make a scalar of it.
        return np.asarray(1 / (1 + np.exp(-(self.bias + features @ np.asarray(self.weights)))))


def confidence_features(best_first: Sequence[PoseHypothesis], visible_px: int) -> Float[np.ndarray, "3"]:
    """Return the cues of a detection's hypotheses, best first, which were refined from several starts.

    The margin is by how much the log score of the best exceeds that of the second distinct pose, 1 at most and where
    all starts ended in one pose or worse ones.
    """
    logs = np.log([max(hypothesis.score, 1e-6) for hypothesis in best_first[:2]])
    margin = min(logs[0] - logs[1], _WIDEST_MARGIN) if len(logs) > 1 else _WIDEST_MARGIN
    return np.array([logs[0], margin, np.log(max(visible_px, 1))])


def fit_confidence(
    features: Float[np.ndarray, "n 3"], good: Float[np.ndarray, "n"], *, ridge: float = 1.0
) -> Confidence:
    """Return the logistic regression of these outcomes (0 or 1) by Newton's method, with a weak pull to zero weights.

    Raises:
        ConfigError: there are fewer than 20 outcomes, or all are alike.
    """
    if len(good) < 20 or good.min() == good.max():
        raise ConfigError(f"a calibration needs 20 poses or more, good and bad ones, got {len(good)}; take more bins")
    mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-9
    X = np.column_stack([np.ones(len(good)), (features - mean) / spread])
    pull = ridge * np.diag([0.0, *[1.0] * len(FEATURES)])
    w = np.zeros(1 + len(FEATURES))
    for _ in range(50):
        p = 1 / (1 + np.exp(-X @ w))
        H = (X * (p * (1 - p))[:, None]).T @ X + pull
        w -= np.linalg.solve(H, X.T @ (p - good) + pull @ w)
    weights = w[1:] / spread
    return Confidence(float(w[0] - weights @ mean), tuple(float(value) for value in weights))


def read_confidence(file: Path = SHIPPED_FILE) -> Confidence:
    """Return the model that ``simpick refiner calibrate`` wrote to a file.

    Raises:
        ConfigError: the file is missing, damaged, or holds something else; so are other cues or another meaning of
            good.
    """
    again = "make it anew with: simpick refiner calibrate"
    try:
        content = json.loads(file.read_text())
    except FileNotFoundError:
        raise ConfigError(f"there is no file of the refiner's confidence at {file}; {again}") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"the refiner's confidence cannot be read from {file} ({error}); {again}") from None
    content = content if isinstance(content, dict) else {}
    weights, good = content.get("weights"), {"mm": GOOD_MM, "deg": GOOD_DEG}
    if not isinstance(weights, dict) or set(weights) != set(FEATURES) or content.get("good") != good:
        raise ConfigError(
            f"{file} must hold weights of {', '.join(FEATURES)} for a good pose of {good}, "
            f"got weights {weights} and good {content.get('good')}; {again}"
        )
    numbers = [content.get("bias"), *(weights[name] for name in FEATURES)]
    if not all(type(number) in (int, float) and math.isfinite(number) for number in numbers):
        raise ConfigError(f"bias and weights in {file} must be finite numbers, got {numbers}; {again}")
    return Confidence(float(numbers[0]), tuple(float(number) for number in numbers[1:]))
