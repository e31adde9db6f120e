"""Which instances are of the asked parts, decided for all instances of an image together.

One similarity alone hardly distinguishes a half-hidden part from a foreign object. But the instances of an image share
unknowns: the share of them that are of the asked parts, how well these look like their templates here, and how much
foreign objects happen to resemble a part. A few exposed instances show the share; the doubtful ones are then
probable where the asked parts are frequent, and all are dropped where there are none (empirical Bayes). The same holds
for names: parts that the image surely holds are the more probable names of its other instances.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.special import digamma, gammaln, logsumexp, softmax

from simpick.config import from_json, read_json
from simpick.errors import ConfigError
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.detector.resemblance import Resemblance, regressors_of

SHIPPED_FILE = Path(__file__).with_name("composition.json")
_REMEDY = "make it again with: simpick detector-calibrate"


@dataclass(frozen=True)
class InstanceModel:
    """What is known of instances before an image is seen."""

    asked: Resemblance
    """Of right masks of the asked parts."""
    foreign: Resemblance
    """Of right masks of other objects."""
    fragment: Resemblance
    """Of masks that overlap no instance by an IoU of one half."""


@dataclass(frozen=True)
class CompositionModel:
    """What ``simpick detector-calibrate`` fits."""

    known_distance: InstanceModel
    free_distance: InstanceModel


_FITTED = tuple(field.name for field in fields(CompositionModel))
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
_LEAST_DENSITY = 1e-9
_ROUNDS = 12

# Weights of the log-odds of names: of the similarity, what it gains with the square of the exposure, of the agreement
# of colours relative to both, and of the odds of views, which are not independent of the similarity.
_SHAPE, _EXPOSED_SHAPE, _COLOURS, _VIEWS = 12.5, 12.6, 2.5, 1.0


@dataclass(frozen=True, eq=False)
class JudgedInstances:
    """What the instances of one image are, as far as the similarities show."""

    probability: Float[np.ndarray, "instances"]
    """That the mask is right and shows the part of the given name."""
    part: Int[np.ndarray, "instances"]
    """Index of the most probable part."""
    presence: float
    """Probability that the image shows any of the asked parts."""


def judge_instances(instances: ComparedInstances, composition: CompositionModel) -> JudgedInstances:
    """Return what the instances of one image probably are; there must be at least one."""
    model = composition.known_distance if instances.is_distance_known else composition.free_distance
    candidates = instances.similarity.shape[1]
    log_odds = name_odds(instances)
    measures = measures_of(instances, log_odds.argmax(axis=1))
    regressors = regressors_of(instances.exposure, candidates)
    is_right = np.clip(instances.scores, 0.01, 0.99)

    def density(kind: Resemblance) -> Float[np.ndarray, "instances deviations"]:
        return np.exp(kind.log_density(measures, regressors, _DEVIATIONS)) + _LEAST_DENSITY

    asked = is_right[:, None] * density(model.asked)
    foreign = is_right[:, None] * density(model.foreign)
    fragment = (1 - is_right) * (density(model.fragment) @ _DEVIATION_WEIGHTS)
    # Axes: instances, shares, deviations of the asked parts, deviations of foreign objects.
    of_asked = _SHARES[:, None, None] * asked[:, None, :, None]
    of_all = of_asked + (1 - _SHARES)[:, None, None] * foreign[:, None, None, :] + fragment[:, None, None, None]
    log_weights = _WEIGHT * np.log(of_all).sum(axis=0) + _log_prior(candidates)
    weights = np.exp(log_weights - logsumexp(log_weights))
    is_asked = (weights * of_asked / of_all).sum(axis=(1, 2, 3))

    names = _names(log_odds, is_asked)
    return JudgedInstances(is_asked * names.max(axis=1), names.argmax(axis=1), float(1 - weights[0].sum()))


def name_odds(instances: ComparedInstances) -> Float[np.ndarray, "instances parts"]:
    """Return the log-odds of each name, but for a constant per instance."""
    sharpness = _SHAPE + _EXPOSED_SHAPE * instances.exposure**2
    return sharpness[:, None] * (instances.similarity + _COLOURS * instances.colours) + _VIEWS * instances.views


def measures_of(instances: ComparedInstances, part: Int[np.ndarray, "instances"]) -> Float[np.ndarray, "instances 2"]:
    """Return how much each instance resembles the part of this index, as `Resemblance` takes it."""
    rows = np.arange(len(part))
    return np.column_stack([instances.similarity[rows, part], instances.views[rows, part]])


def read_composition(file: Path = SHIPPED_FILE) -> CompositionModel:
    """Return the model that ``simpick detector-calibrate`` wrote to a file.

    Raises:
        ConfigError: the file is missing or damaged.
    """
    try:
        content = read_json(file)
        return from_json(CompositionModel, {name: content[name] for name in _FITTED if name in content}, str(file))
    except ConfigError as error:
        raise ConfigError(f"{error}; {_REMEDY}") from None


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
