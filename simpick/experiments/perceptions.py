"""Perception modes by name: the shipped ones and those that other packages register."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import entry_points
from typing import Literal

import numpy as np

from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.base import PoseEstimator, PoseRefiner
from simpick.estimators.oracle import OracleEstimator, OracleRefiner, PoseNoise
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.experiments.run_config import RunConfig
from simpick.policies import Perception
from simpick.records import InstanceTruth

ENTRY_POINT_GROUP = "simpick.estimators"
"""Where another package registers its estimator: a callable without arguments that returns a `PoseEstimator`."""


@dataclass(frozen=True)
class PoseBudget:
    """How much work ``coarse`` and ``fine`` do; None is their own number."""

    iterations: int | None = None
    """How often they take templates around their own estimate."""
    steps: int | None = None
    """Denoising steps of an answer."""

    def __post_init__(self) -> None:
        if self.steps is not None and self.steps < 1:
            raise ConfigError(f"steps must be 1 or more, got {self.steps}")


def _retrieval(hypotheses: int | None) -> PoseEstimator:
    # Only here, because it loads torch.
    from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator

    return RetrievalEstimator(None if hypotheses is None else RetrievalConfig(hypotheses=hypotheses))


def _retrieval_refined(hypotheses: int | None) -> PoseEstimator:
    return _refine(_retrieval(hypotheses), "retrieval_refined")


def _raypose(
    mode: Literal["coarse", "fine"], hypotheses: int | None, budget: PoseBudget | None = None
) -> PoseEstimator:
    from simpick.estimators.raypose import RayPoseEstimatorConfig, load_estimator

    config = RayPoseEstimatorConfig(hypotheses=1 if hypotheses is None else hypotheses)
    if budget is not None:
        steps = budget.steps or config.steps
        config = dataclasses.replace(config, iterations=budget.iterations, steps=steps)
    return load_estimator(mode, config)


def _refined(hypotheses: int | None) -> PoseEstimator:
    return _refine(_raypose("fine", hypotheses), "refined")


def _refine(base: PoseEstimator, mode: str) -> PoseEstimator:
    from simpick.estimators.refiner import RefinedEstimator, read_confidence

    return RefinedEstimator(base, mode=mode, confidence=read_confidence())


SHIPPED: dict[str, Callable[[int | None], PoseEstimator]] = {
    "retrieval": _retrieval,
    "retrieval_refined": _retrieval_refined,
    "coarse": partial(_raypose, "coarse"),
    "fine": partial(_raypose, "fine"),
    "refined": _refined,
}
"""Estimators that work from images alone and come with simpick; made for this many hypotheses, or their own number."""


def estimator_names() -> list[str]:
    """Return every perception mode that can be asked for."""
    return ["oracle", *SHIPPED, *(e.name for e in entry_points(group=ENTRY_POINT_GROUP))]


def make_estimator(name: str, hypotheses: int | None = None, budget: PoseBudget | None = None) -> PoseEstimator:
    """Return a pose estimator that works from images alone, asked for this many hypotheses or for its own number.

    Raises:
        UnknownNameError: no estimator has this name; the message lists those that exist.
        ConfigError: a number of hypotheses or an budget that the estimator does not take.
    """
    if budget is not None and budget != PoseBudget():
        if name not in ("coarse", "fine"):
            raise ConfigError(f"iterations and steps are of coarse and fine; {name!r} has none. Leave them out")
        return _raypose(name, hypotheses, budget)
    if name in SHIPPED:
        return SHIPPED[name](hypotheses)
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            if hypotheses is not None:
                raise ConfigError(
                    f"{name!r} comes from another package and decides itself how many hypotheses it makes"
                )
            return entry.load()()
    base = name.removesuffix("+closer").partition("@")[0]
    if base != name and base in estimator_names():
        raise ConfigError(f"{name!r} is how a comparison writes it; here write {base}, --hypotheses K, --look-closer")
    raise UnknownNameError(
        "perception", name, estimator_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def make_perception(config: RunConfig, env: BinPickEnv, rng: np.random.Generator) -> Perception:
    """Return the perception that a configuration asks for; the oracle takes its truth from `env`."""
    return _perception(config, env.instance_part_names, env.truth, rng)


def make_vector_perceptions(
    config: RunConfig, envs: BinPickVectorEnv, rngs: Sequence[np.random.Generator]
) -> list[Perception]:
    """Return a perception for each environment, what is random in it from its own `rngs`.

    Shipped estimators that work from images alone are one and the same in all of them, so that they answer in a batch.
    """
    return [
        _perception(config, partial(envs.instance_part_names, k), partial(envs.truth, k), rng)
        for k, rng in enumerate(rngs)
    ]


def _perception(
    config: RunConfig,
    instance_parts: Callable[[], Sequence[str]],
    truth: Callable[[], Sequence[InstanceTruth]],
    rng: np.random.Generator,
) -> Perception:
    detector_rng, noise_rng = rng.spawn(2)
    detector = SegmentationDetector(config.detections, detector_rng, instance_parts=instance_parts)
    if config.perception == "oracle":
        noise = PoseNoise(config.noise_deg, config.noise_mm)
        return Perception("oracle", detector, OracleEstimator(truth, noise, noise_rng))
    make = _shared_estimator if config.perception in SHIPPED else make_estimator
    estimator = make(config.perception, config.hypotheses)
    return Perception(config.perception, detector, estimator)


def make_refiner(config: RunConfig, env: BinPickEnv) -> PoseRefiner:
    """Return who corrects poses by a second look: the truth for the oracle, else this process's one refiner."""
    return OracleRefiner(env.truth) if config.perception == "oracle" else _shared_refiner()


@cache
def _shared_refiner() -> PoseRefiner:
    from simpick.estimators.refiner import Refiner

    return Refiner()


@cache
def _shared_estimator(name: str, hypotheses: int | None) -> PoseEstimator:
    """Return this process's one estimator of that name, so that parts are onboarded once and not once an episode.

    All that were asked for are kept, because a comparison asks for each of its modes in turn, bin after bin.

    Only for shipped ones, which keep nothing between images but their onboarded parts: another package's may keep
    more, and an episode's results must not hang on the episodes before it.
    """
    return make_estimator(name, hypotheses)
