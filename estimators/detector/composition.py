"""Which instances are of the asked parts, decided for all instances of an image together.

One similarity alone hardly distinguishes a half-hidden part from a foreign object. But the instances of an image share
unknowns: the share of them that are of the asked parts, how well these look like their templates here, and how much
foreign objects happen to resemble a part. A few exposed instances show the share; the doubtful ones are then
probable where the asked parts are frequent, and all are dropped where there are none (empirical Bayes). The same holds
for names: parts that the image surely holds are the more probable names of its other instances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import digamma, gammaln, logsumexp, softmax


class _Resemblance(NamedTuple):
    """Similarity of an instance to the most similar of the candidates: a normal distribution.

    Its mean depends on the square of the exposure and on the logarithm of the number of candidates, and deviates from
    image to image.
    """

    mean: float
    exposed: float
    candidates: float
    spread: float
    image_spread: float


class _Fit(NamedTuple):
    asked: _Resemblance
    """Of right masks of the asked parts."""
    foreign: _Resemblance
    """Of right masks of other objects."""
    fragment: _Resemblance
    """Of masks that overlap no instance by an IoU of one half."""
    names: tuple[float, float]
    """Log-odds of names by similarity, and what they gain with the square of the exposure."""


# Fitted on 44 images of 33 held-out bins of random parts, of which all, some or none were asked for.
_KNOWN_DISTANCE = _Fit(
    _Resemblance(0.697, 0.102, 0.007, 0.095, 0.020),
    _Resemblance(0.595, 0.025, 0.034, 0.066, 0.041),
    _Resemblance(0.550, 0.028, 0.024, 0.071, 0.036),
    (20.8, 21.0),
)
_FREE_DISTANCE = _Fit(
    _Resemblance(0.684, 0.099, 0.011, 0.094, 0.031),
    _Resemblance(0.610, 0.035, 0.028, 0.070, 0.048),
    _Resemblance(0.547, 0.013, 0.028, 0.075, 0.033),
    (20.7, 21.2),
)
_SHARES = np.array([0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1])
"""Shares of the asked parts among an image's instances that are considered."""
_NONE, _NOT_ALL = 0.3, 0.65
"""Probabilities that the share is 0 and that it is not 1, before the image is seen, where one part is asked for. They
are divided by the number of candidates: who lists many parts lists all that may be in the bin."""
_WEIGHT = 0.6
"""Of each instance's evidence of the share, because equal objects are similar to a part by the same chance."""
_DEVIATIONS = np.linspace(-2, 2, 7)
_DEVIATION_WEIGHTS = softmax(-0.5 * _DEVIATIONS**2)
"""Deviations of an image that are considered, in standard deviations, and their probabilities."""
_CONCENTRATIONS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Of the Dirichlet distribution of the candidates' shares, per candidate: from few kinds to all in equal shares."""
_ROUNDS = 12
_EVIDENCE = 1.5
"""Weight of the evidence beside the similarity."""
_BESIDE_VIEWS = 0.6
"""Weight of the similarity beside the odds from views: the two are not independent."""


@dataclass(frozen=True, eq=False)
class JudgedInstances:
    """What the instances of one image are, as far as the similarities show."""

    probability: Float[np.ndarray, "instances"]
    """That the mask is right and shows the part of the given name."""
    part: Int[np.ndarray, "instances"]
    """Index of the most probable part."""
    presence: float
    """Probability that the image shows any of the asked parts."""


def judge_instances(
    similarity: Float[np.ndarray, "instances parts"],
    evidence: Float[np.ndarray, "instances parts"],
    view_odds: Float[np.ndarray, "instances parts"] | None,
    exposure: Float[np.ndarray, "instances"],
    mask_scores: Float[np.ndarray, "instances"],
    *,
    is_distance_known: bool,
) -> JudgedInstances:
    """Return what the instances of one image probably are; there must be at least one.

    Where parts are compared with one another, `evidence` adds to the similarities, and `view_odds` are logarithms of
    odds from another source, if there is one. `mask_scores` are the probabilities that the masks are right.
    Similarities are lower where the distance is known.
    """
    fit = _KNOWN_DISTANCE if is_distance_known else _FREE_DISTANCE
    exposed, candidates = exposure**2, similarity.shape[1]
    sharpness = fit.names[0] + fit.names[1] * exposed
    log_odds = sharpness[:, None] * ((1 if view_odds is None else _BESIDE_VIEWS) * similarity + _EVIDENCE * evidence)
    log_odds += 0 if view_odds is None else view_odds
    first = np.take_along_axis(similarity, log_odds.argmax(axis=1)[:, None], axis=1)[:, 0]
    is_right = np.clip(mask_scores, 0.01, 0.99)

    asked = is_right[:, None] * _density(first, exposed, candidates, fit.asked)
    foreign = is_right[:, None] * _density(first, exposed, candidates, fit.foreign)
    fragment = (1 - is_right) * (_density(first, exposed, candidates, fit.fragment) @ _DEVIATION_WEIGHTS)
    # Axes: instances, shares, deviations of the asked parts, deviations of foreign objects.
    of_asked = _SHARES[:, None, None] * asked[:, None, :, None]
    of_all = of_asked + (1 - _SHARES)[:, None, None] * foreign[:, None, None, :] + fragment[:, None, None, None]
    log_weights = _WEIGHT * np.log(of_all).sum(axis=0) + _log_prior(candidates)
    weights = np.exp(log_weights - logsumexp(log_weights))
    is_asked = (weights * of_asked / of_all).sum(axis=(1, 2, 3))

    names = _names(log_odds, is_asked)
    return JudgedInstances(is_asked * names.max(axis=1), names.argmax(axis=1), float(1 - weights[0].sum()))


def _density(
    similarity: Float[np.ndarray, "instances"],
    exposed: Float[np.ndarray, "instances"],
    candidates: int,
    kind: _Resemblance,
) -> Float[np.ndarray, "instances deviations"]:
    """Return the density of each similarity for each deviation of the image, without the factor of 2 pi."""
    mean = kind.mean + kind.exposed * exposed + kind.candidates * np.log(candidates)
    offset = (similarity - mean)[:, None] - kind.image_spread * _DEVIATIONS
    return np.exp(-0.5 * (offset / kind.spread) ** 2) / kind.spread + 1e-9


def _log_prior(candidates: int) -> Float[np.ndarray, "shares asked foreign"]:
    shares = np.full(len(_SHARES), (_NOT_ALL - _NONE) / candidates / (len(_SHARES) - 2))
    shares[0], shares[-1] = _NONE / candidates, 1 - _NOT_ALL / candidates
    deviations = np.log(_DEVIATION_WEIGHTS)
    return np.log(shares)[:, None, None] + deviations[:, None] + deviations


def _names(
    log_odds: Float[np.ndarray, "instances parts"], is_asked: Float[np.ndarray, "instances"]
) -> Float[np.ndarray, "instances parts"]:
    """Return the probability of each name of each instance, with shares of the parts that suit all.

    Variational Bayes of a mixture, for each concentration; each counts by its lower bound of the evidence (Bishop,
    Pattern Recognition and Machine Learning, 10.2).
    """
    candidates, names, bounds = log_odds.shape[1], [], []
    for concentration in _CONCENTRATIONS:
        of_each = softmax(log_odds, axis=1)
        for _ in range(_ROUNDS):
            counts = is_asked @ of_each + concentration
            log_shares = digamma(counts) - digamma(counts.sum())
            of_each = softmax(log_odds + log_shares, axis=1)
        counts = is_asked @ of_each + concentration
        log_shares = digamma(counts) - digamma(counts.sum())
        prior = gammaln(candidates * concentration) - candidates * gammaln(concentration)
        posterior = gammaln(counts.sum()) - gammaln(counts).sum()
        divergence = posterior - prior + ((counts - concentration) * log_shares).sum()
        bounds.append(is_asked @ logsumexp(log_odds + log_shares, axis=1) - divergence)
        names.append(of_each)
    return np.tensordot(softmax(bounds), names, axes=1)
