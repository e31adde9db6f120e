"""`Refiner`: aligns renderings with the image and ranks poses by the image's evidence. No weights but six of a sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.estimators.floor import UNKNOWN_REST, Floor
from simpick.estimators.pose_selection import best_per_group, distinct_poses
from simpick.estimators.refiner.confidence import Confidence, read_confidence
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.estimators.refiner.crop_renderer import CropRenderer, rows_by_part
from simpick.estimators.refiner.evidence import evidence
from simpick.estimators.refiner.level_search import LevelSearch
from simpick.estimators.refiner.levenberg_marquardt import minimise
from simpick.estimators.refiner.lone_masks import are_alone
from simpick.estimators.refiner.query_maps import QueryMaps, query_maps
from simpick.estimators.valid_detections import check_onboarded, detection_mask, has_shape
from simpick.geometry import box_of_mask, invert
from simpick.records import CameraFrame, Detection, PoseHypothesis
from simpick.tensor_record import TensorRecord

_LEAST_MASK_PX = 16
_JUDGED_AT_ONCE = 8
"""Poses whose evidence is measured at a time: their maps stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Finalist:
    """A pose that may answer a detection, with the evidence for it."""

    T_camera_part: Float[np.ndarray, "4 4"]
    cues: Float[np.ndarray, "cues"]
    """See `simpick.estimators.refiner.confidence`."""


class Refiner(Closing):
    """Improves hypotheses until renderings of the part match the image; see `alignment`.

    Implements `PoseRefiner`. A context manager: `close` frees its OpenGL contexts.
    """

    def __init__(self, config: RefinerConfig | None = None, confidence: Confidence | None = None) -> None:
        """Take the probability that a pose is good by its evidence; the shipped one by default."""
        self.config = config or RefinerConfig()
        self._confidence = confidence or read_confidence()
        self._parts: dict[str, Part] = {}
        self._renderer = CropRenderer(self.config.renderers, max(level.size_px for level in self.config.levels))

    def onboard(self, part: Part) -> None:
        """Register the part; its renderer is made when it is first needed."""
        self._parts[part.name] = part

    def refine(
        self,
        frame: CameraFrame,
        detections: Sequence[Detection],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[tuple[PoseHypothesis, ...]]:
        """Return each detection's refined hypotheses, best first, near-identical ones merged.

        Scores are probabilities that a pose is good enough to pick by. The first hypothesis itself is among the
        answers and comes first if the image supports it best. Where the frame says where the bin's floor is, poses do
        not reach below it.

        Hypotheses that are not rotation matrices, not finite, or behind the camera are ignored. A detection without
        valid hypotheses, without a mask, or with a mask of fewer than 16 pixels or a single line of them, gets its
        hypotheses back unchanged.

        Raises:
            ConfigError: there are not as many lists of hypotheses as detections, or a mask is not of the image's size.
            UnknownNameError: a detection's part has not been onboarded.
        """
        finalists = self.finalists(frame, detections, hypotheses)
        return [
            tuple(own) if found is None else self._ranked(self._parts[detection.part], found)
            for detection, own, found in zip(detections, hypotheses, finalists, strict=True)
        ]

    def finalists(
        self,
        frame: CameraFrame,
        detections: Sequence[Detection],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[list[Finalist] | None]:
        """Return the poses among which `refine` chooses, with the evidence for each; None where it changes nothing."""
        if len(hypotheses) != len(detections):
            raise ConfigError(
                f"there must be one list of hypotheses for each detection, got {len(hypotheses)} for {len(detections)}"
            )
        check_onboarded(detections, self._parts)
        # A box is no mask: it is neither an outline to fit nor what hides others.
        masks = {k: detection_mask(d, frame) for k, d in enumerate(detections) if d.mask is not None}
        usable = [[h.T_camera_part for h in own if _is_valid(h.T_camera_part)] for own in hypotheses]
        rows = [k for k, mask in masks.items() if usable[k] and has_shape(mask, _LEAST_MASK_PX)]
        answers: list[list[Finalist] | None] = [None] * len(detections)
        if not rows:
            return answers
        parts = [self._parts[detections[k].part] for k in rows]
        floor = Floor.below(frame, parts, [usable[k][0] for k in rows])
        alone = are_alone([masks[k] for k in rows], list(masks.values()))
        queries = self._queries(frame, [masks[k] for k in rows], list(masks.values()))
        # As many parts together as renderers stay open, so that none is opened again at each level.
        names = list(dict.fromkeys(part.name for part in parts))
        for first in range(0, len(names), self.config.renderers):
            group = names[first : first + self.config.renderers]
            mine = [i for i, part in enumerate(parts) if part.name in group]
            start = _State.of(mine, [usable[rows[i]] for i in mine])
            if floor is not None:
                start = start.at(_raised(floor, [parts[k] for k in start.detection], start.Ts_camera_part))
            state = start
            for level, query in zip(self.config.levels, queries, strict=True):
                state = self._at_level(level, query, parts, floor, state.best(level.keep))
                state = self._distinct(parts, state)
            state = _State.cat([start.best(1), state])
            cues = self._cues(parts, queries[-1], floor, alone, state)
            for i in mine:
                own = np.flatnonzero(state.detection == i)
                answers[rows[i]] = [Finalist(state.Ts_camera_part[j], cues[j]) for j in own]
        return answers

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self._renderer.close()

    def _queries(
        self,
        frame: CameraFrame,
        masks: Sequence[Bool[np.ndarray, "height width"]],
        all_masks: Sequence[Bool[np.ndarray, "height width"]],
    ) -> list[QueryMaps]:
        """Return the maps of these masks at each level."""
        covered = np.sum(all_masks, axis=0, dtype=np.int32)
        others = [(covered - mask) > 0 for mask in masks]
        boxes = np.stack([box_of_mask(mask) for mask in masks])
        config = self.config
        weight = config.occluder_weight
        return [
            query_maps(frame, masks, boxes, others, level.size_px, padding=config.padding, occluder_weight=weight)
            for level in config.levels
        ]

    def _at_level(
        self, level: AlignmentLevel, query: QueryMaps, parts: Sequence[Part], floor: Floor | None, state: _State
    ) -> _State:
        """Refine all hypotheses at one level."""
        own, their_parts = query.rows(state.detection), [parts[k] for k in state.detection]
        Ts_crop_camera = own.cameras.Ts_crop_camera
        search = LevelSearch(self._renderer, their_parts, level, own, floor, self.config)
        minimum = minimise(Ts_crop_camera @ state.Ts_ahead, search.evaluate, level.iterations)
        Ts_camera_crop = invert(Ts_crop_camera)
        return _State(
            state.detection, Ts_camera_crop @ minimum.Ts_crop_part, Ts_camera_crop @ minimum.Ts_ahead, minimum.misfit
        )

    def _distinct(self, parts: Sequence[Part], state: _State) -> _State:
        """Return the hypotheses without those that converged to the pose of a better one of the same detection."""
        kept = []
        for k in np.unique(state.detection):
            own = np.flatnonzero(state.detection == k)
            kept.append(own[self._distinct_rows(parts[k], state.Ts_camera_part[own], -state.misfit[own])])
        return state.rows(np.sort(np.concatenate(kept)))

    def _distinct_rows(
        self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"], scores: Float[np.ndarray, "n"]
    ) -> Int[np.ndarray, "k"]:
        return distinct_poses(
            Ts_camera_part,
            scores,
            part.symmetries,
            part.diameter_m,
            rotation_deg=self.config.merge_deg,
            translation_diameters=self.config.merge_diameters,
        )

    def _cues(
        self,
        parts: Sequence[Part],
        query: QueryMaps,
        floor: Floor | None,
        alone: Bool[np.ndarray, "detections"],
        state: _State,
    ) -> Float[np.ndarray, "n cues"]:
        """Return the evidence for all poses."""
        own, their_parts = query.rows(state.detection), [parts[k] for k in state.detection]
        rendered = self._renderer.maps(their_parts, own.cameras, own.cameras.Ts_crop_camera @ state.Ts_camera_part)
        with torch.inference_mode():
            chunks = np.split(np.arange(len(their_parts)), range(_JUDGED_AT_ONCE, len(their_parts), _JUDGED_AT_ONCE))
            cues = torch.cat([evidence(own.rows(c), rendered.rows(c)) for c in chunks]).double().numpy()
        rest = np.full(len(cues), UNKNOWN_REST)
        if floor is not None:
            for part, rows in rows_by_part(their_parts):
                rest[rows] = floor.rest(part, state.Ts_camera_part[rows])
            # A part among others may lean on them.
            rest[~alone[state.detection]] = UNKNOWN_REST
        return np.column_stack([cues, rest])

    def _ranked(self, part: Part, finalists: Sequence[Finalist]) -> tuple[PoseHypothesis, ...]:
        """Return the distinct poses, the most probable first."""
        scores = self._confidence.probability(np.stack([finalist.cues for finalist in finalists]))
        Ts = np.stack([finalist.T_camera_part for finalist in finalists])
        return tuple(PoseHypothesis(Ts[k], float(scores[k])) for k in self._distinct_rows(part, Ts, scores))


@dataclass(frozen=True, eq=False)
class _State(TensorRecord):
    """The hypotheses of detections between two levels."""

    detection: Int[np.ndarray, "n"]
    """Row of the detection that each belongs to."""
    Ts_camera_part: Float[np.ndarray, "n 4 4"]
    Ts_ahead: Float[np.ndarray, "n 4 4"]
    """Where the next level begins: one step beyond `Ts_camera_part`."""
    misfit: Float[np.ndarray, "n"]

    @staticmethod
    def of(detections: Sequence[int], poses: Sequence[Sequence[Float[np.ndarray, "4 4"]]]) -> _State:
        """Return the start; the order of a detection's poses stands for their misfit."""
        detection = np.repeat(np.array(detections), [len(own) for own in poses])
        order = np.concatenate([np.arange(len(own)) for own in poses])
        Ts = np.array([T for own in poses for T in own])
        return _State(detection, Ts, Ts, order.astype(float))

    def at(self, Ts_camera_part: Float[np.ndarray, "n 4 4"]) -> _State:
        """Return the hypotheses in other poses."""
        return _State(self.detection, Ts_camera_part, Ts_camera_part, self.misfit)

    def best(self, count: int) -> _State:
        """Return the `count` best hypotheses of each detection, in their present order."""
        return self.rows(np.sort(best_per_group(self.detection, self.misfit, count)))


def _raised(
    floor: Floor, parts: Sequence[Part], Ts_camera_part: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "n 4 4"]:
    """Return the poses of these parts, raised onto the floor."""
    Ts = Ts_camera_part.copy()
    for part, rows in rows_by_part(parts):
        Ts[rows] = floor.raised(part, Ts[rows])
    return Ts


def _is_valid(T_camera_part: Float[np.ndarray, "4 4"]) -> bool:
    """Return whether a pose is finite, a rotation, and in front of the camera."""
    R = T_camera_part[:3, :3]
    return bool(
        np.isfinite(T_camera_part).all() and T_camera_part[2, 3] > 0.02 and np.abs(R @ R.T - np.eye(3)).max() < 1e-3
    )
