"""The distributions that `simpick.estimators.detector.composition` judges by, fitted on bins of random parts.

The parts are of seeds that no network is trained on; library parts are never used.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from simpick.activity import counted
from simpick.assets.library import get_part
from simpick.caching import atomic_write_text
from simpick.errors import ConfigError
from simpick.estimators.boundary import onboard_parts, without_truth
from simpick.estimators.detector import LearnedDetector
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.detector.composition import CompositionModel, InstanceModel, measures_of, name_odds
from simpick.estimators.detector.resemblance import Resemblance, fit_resemblance, regressors_of
from simpick.metrics.masks import mask_overlaps
from simpick.pose_eval.benchmark_bins import BenchmarkBin
from simpick.pose_eval.bin_images import BinView
from simpick.scene import SceneConfig

FOREIGN, FRAGMENT = -1, -2
"""Instead of a candidate's index: a right mask of another object, and a mask that overlaps no instance well enough."""
_POOL = tuple(f"random_{seed}" for seed in range(700_001, 700_081, 2))
"""Validation parts have odd seeds (`random_part_seed`)."""
_FIRST_BIN_SEED = 63_000
_KINDS, _COUNTS = (28, 3, 28, 1, 1), ((12, 30, 50), (30,), (50, 12, 30), (40,), (12,))
"""Of five bins in a row: candidates that a bin is filled from, and numbers of parts, in turn."""
_LEAST_VISIBLE = 0.3
_LEAST_ANSWERS = 5
_HEAVY_TAILS = 4.0
"""Degrees of freedom of Student's t distribution."""


@dataclass(frozen=True, eq=False)
class LabelledInstances:
    """Answer to one request, and what its instances are."""

    instances: ComparedInstances
    shown: Int[np.ndarray, "instances"]
    """Index of the candidate that the instance is of, `FOREIGN` or `FRAGMENT`."""


def calibration_bins(count: int) -> tuple[BenchmarkBin, ...]:
    """Return the first bins: mixed of many parts, of three, and of one; a third of them as photographs."""
    return tuple(_bin(number) for number in range(count))


def _bin(number: int) -> BenchmarkBin:
    rng = np.random.default_rng([_FIRST_BIN_SEED, number])
    group, place = divmod(number, len(_KINDS))
    kinds, counts = _KINDS[place], _COUNTS[place]
    if kinds > 1:
        parts = tuple(sorted(str(name) for name in rng.choice(_POOL, kinds, replace=False)))
    else:
        parts = (_POOL[(2 * group + place - 3) % len(_POOL)],)
    return BenchmarkBin(
        "mixed" if kinds > 1 else "homogeneous",
        _FIRST_BIN_SEED + number,
        SceneConfig(parts=parts, count=counts[group % len(counts)], robot=None, randomization="default"),
        "photo" if (group + place) % 3 == 2 else "default",
    )


def requests(bin: BenchmarkBin, view: BinView) -> list[tuple[str, ...]]:
    """Return what is asked for in a bin: all that it may hold, one part that is there or not, and many, some there."""
    rng = np.random.default_rng((bin.seed, 7))
    there = {part.name for part in view.parts}
    held = sorted({truth.part for truth in view.truths if truth.visible_fraction >= _LEAST_VISIBLE})
    absent = [name for name in _POOL if name not in there]

    def draw(names: Sequence[str], count: int) -> tuple[str, ...]:
        return tuple(str(name) for name in rng.permutation(names)[:count])

    asked = [bin.config.parts]
    if len(bin.config.parts) > 1:
        asked += [(name,) for name in draw(held, 4)]
    asked += [(name,) for name in draw(absent, 4)]
    asked.append(draw(absent, 10))
    some = draw(held, 5)
    asked.append((*some, *draw(absent, 10 - len(some))))
    if len(bin.config.parts) < 28:
        others = [name for name in absent if name not in bin.config.parts]
        asked += [(*bin.config.parts, *draw(others, 28 - len(bin.config.parts))), draw(others, 28)]
    return asked


def label_bin(detector: LearnedDetector, bin: BenchmarkBin, view: BinView) -> Iterator[tuple[LabelledInstances, ...]]:
    """Yield for each request what was found, compared with the distance known and, the same masks, without it."""
    known = without_truth(view.frame)
    free = type(known)(known.rgb, known.camera, np.eye(4))
    for names in counted(requests(bin, view), "request"):
        parts = [get_part(name) for name in names]
        onboard_parts([detector], parts)
        found = detector.compare(known, parts)
        if found.masks:
            shown = _shown(view, found, names)
            again = detector.compare_masks(free, found.masks, found.scores, parts)
            yield LabelledInstances(found, shown), LabelledInstances(again, shown)


def _shown(view: BinView, found: ComparedInstances, names: Sequence[str]) -> Int[np.ndarray, "instances"]:
    ids = view.frame.instances
    assert ids is not None
    seen = [truth for truth in view.truths if (ids == truth.instance).any()]
    overlaps = mask_overlaps(
        np.array(found.masks, bool).reshape(-1, *ids.shape),
        found.scores,
        np.array([ids == truth.instance for truth in seen], bool).reshape(-1, *ids.shape),
        np.array([truth.visible_fraction for truth in seen], float),
    )
    best = overlaps.iou.argmax(axis=1)
    index = {name: k for k, name in enumerate(names)}
    part = np.array([index.get(seen[k].part, FOREIGN) for k in best], int)
    return np.where(overlaps.iou.max(axis=1) >= 0.5, part, FRAGMENT)


def fit_instances(answers: Sequence[LabelledInstances]) -> InstanceModel:
    """Return the distributions of asked parts, foreign objects and fragments.

    Half-hidden parts and pieces of parts deviate far, so theirs have heavy tails. A foreign object seldom resembles
    what is asked for that much: its tails decide whether a lone part is there.

    Raises:
        ConfigError: a kind of instance is missing or hardly there.
    """

    def fit(is_kind: Callable[[np.ndarray], Bool[np.ndarray, "instances"]], freedom: float | None) -> Resemblance:
        images = []
        for answer in answers:
            own, chosen = answer.instances, is_kind(answer.shown)
            measures = measures_of(own, name_odds(own).argmax(axis=1))
            if chosen.any():
                images.append((measures[chosen], regressors_of(own.exposure, own.similarity.shape[1])[chosen]))
        if len(images) < _LEAST_ANSWERS:
            raise ConfigError(
                f"a calibration needs {_LEAST_ANSWERS} answers or more with each kind of instance, got {len(images)}; "
                "take more bins"
            )
        return fit_resemblance(images, freedom)

    return InstanceModel(
        fit(lambda shown: shown >= 0, _HEAVY_TAILS),
        fit(lambda shown: shown == FOREIGN, None),
        fit(lambda shown: shown == FRAGMENT, _HEAVY_TAILS),
    )


def fit_composition(answers: Sequence[tuple[LabelledInstances, LabelledInstances]]) -> CompositionModel:
    """Return the model of answers as `label_bin` yields them; raises ConfigError as `fit_instances`."""
    return CompositionModel(*(fit_instances(own) for own in zip(*answers, strict=True)))


def write_composition(model: CompositionModel, provenance: dict[str, Any], file: Path) -> None:
    """Write the model with its provenance."""
    atomic_write_text(file, json.dumps({**asdict(model), **provenance}, indent=2) + "\n")
