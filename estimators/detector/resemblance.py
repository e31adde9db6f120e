"""How much instances resemble what is asked for: the distribution of two measures, fitted on bins of random parts.

The measures are the similarity of descriptors and the logarithm of the odds of views, both of the part that an instance
is named. They are jointly distributed; the means change with exposure and number of candidates, and deviate from image
to image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from jaxtyping import Float

from simpick.config import Config
from simpick.errors import ConfigError

MEASURES = 2
_ROUNDS = 200
_Value = Annotated[float, Interval(ge=-1e6, le=1e6)]
_Pair = tuple[_Value, _Value]
_LEAST_VARIANCE = 1e-9
"""Along any axis; what varies less is a fault, for the measures of images vary by more."""


@dataclass(frozen=True)
class Resemblance(Config):
    """Measures of instances of one kind."""

    mean: tuple[_Pair, _Pair, _Pair]
    """Of both measures: constant, and per square of the exposure and logarithm of the number of candidates."""
    covariance: tuple[_Pair, _Pair]
    """Of instances of one image."""
    deviation: _Pair
    """One standard deviation of an image's mean; both measures deviate together."""
    freedom: Annotated[float, Interval(ge=1, le=1e6)] | None
    """Degrees of freedom of Student's t distribution, whose tails are heavy; None for a normal one."""

    def _check_rules(self) -> None:
        covariance = np.array(self.covariance)
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] < _LEAST_VARIANCE:
            raise ConfigError(f"covariance must be symmetric and positive definite, got {covariance.tolist()}")

    def log_density(
        self,
        measures: Float[np.ndarray, "instances 2"],
        regressors: Float[np.ndarray, "instances 3"],
        deviations: Float[np.ndarray, "deviations"],
    ) -> Float[np.ndarray, "instances deviations"]:
        """Return the logarithm of each instance's density, but for a constant, for each deviation of the image."""
        offset = (measures - regressors @ np.array(self.mean))[:, None] - deviations[:, None] * np.array(self.deviation)
        precision = np.linalg.inv(np.array(self.covariance))
        _, log_volume = np.linalg.slogdet(precision)
        square = np.einsum("ndi,ij,ndj->nd", offset, precision, offset)
        if self.freedom is not None:
            square = (self.freedom + MEASURES) * np.log1p(square / self.freedom)
        return 0.5 * (log_volume - square)


def regressors_of(exposure: Float[np.ndarray, "instances"], candidates: int) -> Float[np.ndarray, "instances 3"]:
    """Return what the means depend on."""
    return np.column_stack([np.ones(len(exposure)), exposure**2, np.full(len(exposure), np.log(candidates))])


def fit_resemblance(
    images: Sequence[tuple[Float[np.ndarray, "_ 2"], Float[np.ndarray, "_ 3"]]],
    freedom: float | None = None,
) -> Resemblance:
    """Return the most probable distribution of measures and regressors, one pair of arrays per image.

    A linear mixed model by expectation maximization (Laird & Ware 1982), of normal distributions; `freedom` is added to
    its result. Of the images' deviations the axis that is largest relative to the instances' covariance is kept, the
    others are added to that covariance.
    """
    y, X = (np.concatenate(arrays) for arrays in zip(*images, strict=True))
    mean = np.linalg.lstsq(X, y, rcond=None)[0]
    within = np.cov((y - X @ mean).T)
    between = within / 4
    gram = np.linalg.pinv(X.T @ X)
    counts = np.array([len(own) for own, _ in images])
    number = np.repeat(np.arange(len(images)), counts)
    for _ in range(_ROUNDS):
        residual = y - X @ mean
        sums = np.stack([np.bincount(number, r, len(images)) for r in residual.T], axis=1)
        # The posterior of each image's deviation.
        precision = np.linalg.inv(within)
        spread = np.linalg.inv(np.linalg.inv(between) + counts[:, None, None] * precision)
        deviation = np.einsum("kij,jl,kl->ki", spread, precision, sums)
        mean = gram @ X.T @ (y - deviation[number])
        left = y - X @ mean - deviation[number]
        within = (left.T @ left + np.einsum("k,kij->ij", counts, spread)) / len(y)
        between = (deviation.T @ deviation + spread.sum(axis=0)) / len(images)
    whitened = np.linalg.inv(np.linalg.cholesky(within))
    sizes, axes = np.linalg.eigh(whitened @ between @ whitened.T)
    main = np.sqrt(sizes[-1]) * np.linalg.solve(whitened, axes[:, -1])
    covariance = within + between - np.outer(main, main)
    return Resemblance(_rows(mean), _rows(covariance), _rows(main), freedom)


def _rows(values: np.ndarray) -> tuple:
    return tuple(float(v) if np.ndim(v) == 0 else _rows(v) for v in values)
