"""The probability that a pose is good enough to pick by, from the evidence for it in the image.

It ranks the poses of one detection and is the score of the answer.

A logistic regression, fitted by ``simpick refiner calibrate`` on bins of random training parts, never on library parts
or user CAD. ``confidence.json`` is its result, with a description of the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Interval
from jaxtyping import Float

from simpick.config import from_json, read_json
from simpick.errors import ConfigError

SHIPPED_FILE = Path(__file__).with_name("confidence.json")
FEATURES = ("outline_edges", "inner_edges", "predicted_edges", "shading", "mask", "rest")
"""The cues of `simpick.estimators.refiner.evidence`, and `simpick.estimators.floor.Floor.rest`."""
GOOD_MM, GOOD_DEG = 5.0, 10.0
"""A pose is good enough below these errors, which the jaw tolerates in nearly all cases (``simpick sweep``)."""
_GOOD = {"mm": GOOD_MM, "deg": GOOD_DEG}
_REMEDY = "make it again with: simpick refiner calibrate"
_Weight = Annotated[float, Interval(ge=-1e6, le=1e6)]


@dataclass(frozen=True)
class Confidence:
    """A logistic model: ``p = 1 / (1 + exp(-(bias + weights . features)))``."""

    bias: float
    weights: tuple[float, ...]
    """One per feature of `FEATURES`."""

    def probability(self, features: Float[np.ndarray, "*batch cues"]) -> Float[np.ndarray, "*batch"]:
        """Return the probability that a pose with these features is good."""
        # NumPy would return a scalar for a single pose.
        return np.asarray(1 / (1 + np.exp(-(self.bias + features @ np.asarray(self.weights)))))


@dataclass(frozen=True)
class _Stored:
    """What is read of the file."""

    bias: _Weight
    weights: dict[str, _Weight]
    good: dict[str, float]


def fit_confidence(
    features: Float[np.ndarray, "n cues"],
    good: Float[np.ndarray, "n"],
    *,
    ridge: float = 1.0,
    image_weights_of: Confidence | None = None,
) -> Confidence:
    """Return the logistic regression of these outcomes (0 or 1), by Newton's method with L2 regularisation.

    With `image_weights_of`, the weights of all cues but "rest" are its, and only the bias and the weight of "rest" are
    fitted.

    Raises:
        ConfigError: there are fewer than 20 outcomes, or all are the same.
    """
    if len(good) < 20 or good.min() == good.max():
        raise ConfigError(f"a calibration needs 20 poses or more, good and bad ones, got {len(good)}; take more bins")
    weights = np.zeros(len(FEATURES)) if image_weights_of is None else np.array(image_weights_of.weights)
    fitted = [k for k, name in enumerate(FEATURES) if image_weights_of is None or name == "rest"]
    weights[fitted] = 0.0
    given = features @ weights
    mean, spread = features[:, fitted].mean(axis=0), features[:, fitted].std(axis=0) + 1e-9
    X = np.column_stack([np.ones(len(good)), (features[:, fitted] - mean) / spread])
    penalty = ridge * np.diag([0.0, *[1.0] * len(fitted)])
    w = np.zeros(1 + len(fitted))
    # Newton's method diverges from where all probabilities are near 0 or 1.
    w[0] = -given.mean()
    for _ in range(50):
        p = 1 / (1 + np.exp(-(given + X @ w)))
        H = (X * (p * (1 - p))[:, None]).T @ X + penalty
        w -= np.linalg.solve(H, X.T @ (p - good) + penalty @ w)
    weights[fitted] = w[1:] / spread
    return Confidence(float(w[0] - weights[fitted] @ mean), tuple(float(value) for value in weights))


def read_confidence(file: Path = SHIPPED_FILE) -> Confidence:
    """Return the model that ``simpick refiner calibrate`` wrote to a file.

    Raises:
        ConfigError: the file is missing, damaged, or of other features or another limit of good.
    """
    try:
        content = read_json(file)
        stored = from_json(
            _Stored, {name: content[name] for name in ("bias", "weights", "good") if name in content}, str(file)
        )
    except ConfigError as error:
        raise ConfigError(f"{error}; {_REMEDY}") from None
    if set(stored.weights) != set(FEATURES) or stored.good != _GOOD:
        raise ConfigError(
            f"{file} must hold weights of {', '.join(FEATURES)} for a good pose of {_GOOD}, "
            f"got weights {stored.weights} and good {stored.good}; {_REMEDY}"
        )
    return Confidence(stored.bias, tuple(stored.weights[name] for name in FEATURES))
