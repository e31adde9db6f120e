"""`Refiner`: aligns renderings with the image and says which hypothesis fits best. No training, no weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from simpick.assets.part import Part
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.answerable import detection_mask
from simpick.estimators.pose_clusters import cluster_hypotheses
from simpick.estimators.refiner.alignment import Alignment, Target, align
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.estimators.refiner.levenberg_marquardt import minimise
from simpick.estimators.refiner.part_renderers import PartRenderers
from simpick.estimators.refiner.query_maps import QueryMaps, query_maps
from simpick.estimators.refiner.rendered_maps import rendered_maps
from simpick.geometry import VirtualCameras, box_of_mask, invert
from simpick.records import CameraFrame, Detection, PoseHypothesis

_SOFTNESS = 0.35
"""Misfit at which the score is 1/e."""
_LEAST_MASK_PX = 16


class Refiner:
    """Moves hypotheses until the part, rendered there, looks like the image; see `alignment` for how.

    Closable, for it keeps OpenGL contexts; a context manager too.
    """

    def __init__(self, config: RefinerConfig | None = None) -> None:
        self.config = config or RefinerConfig()
        self._parts: dict[str, Part] = {}
        self._renderers = PartRenderers(self.config.renderers, max(level.size_px for level in self.config.levels))

    def onboard(self, part: Part) -> None:
        """Remember the part; its renderer is made when it is first needed."""
        self._parts[part.name] = part

    def refine(
        self,
        frame: CameraFrame,
        detections: Sequence[Detection],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[tuple[PoseHypothesis, ...]]:
        """Return each detection's refined hypotheses, best first, near-identical ones merged.

        Scores are in (0, 1]: exp(-misfit / 0.35). A detection without hypotheses, or with too small a mask to compare
        (16 px, or a single line of them), is answered by its hypotheses as they came, as are poses that are not finite
        or behind the camera.

        Raises:
            ConfigError: there are not as many lists of hypotheses as detections, or a mask is not of the image's size.
            UnknownNameError: a detection's part has not been onboarded.
        """
        if len(hypotheses) != len(detections):
            raise ConfigError(
                f"there must be one list of hypotheses for each detection, got {len(hypotheses)} for {len(detections)}"
            )
        for detection in detections:
            if detection.part not in self._parts:
                raise UnknownNameError(
                    "onboarded part", detection.part, self._parts, "Call onboard(part) before refine()."
                )
        masks = [detection_mask(detection, frame) for detection in detections]
        usable = [[h for h in own if _is_sound(h.T_camera_part)] for own in hypotheses]
        rows = [k for k, mask in enumerate(masks) if usable[k] and _is_comparable(mask)]
        answers = [tuple(own) for own in hypotheses]
        if rows:
            refined = self._refine(frame, masks, [detections[k].part for k in rows], rows, [usable[k] for k in rows])
            for k, best_first in zip(rows, refined, strict=True):
                answers[k] = best_first
        return answers

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._renderers.close()

    def __enter__(self) -> Refiner:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _refine(
        self,
        frame: CameraFrame,
        masks: Sequence[Bool[np.ndarray, "height width"]],
        parts: Sequence[str],
        rows: Sequence[int],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[tuple[PoseHypothesis, ...]]:
        covered = np.sum(masks, axis=0, dtype=np.int32)
        own = [masks[k] for k in rows]
        others = [(covered - mask) > 0 for mask in own]
        boxes = np.stack([box_of_mask(mask) for mask in own])
        state = _State.of([[h.T_camera_part for h in some] for some in hypotheses])
        for level in self.config.levels:
            state = state.best(level.keep)
            query = query_maps(
                frame,
                own,
                boxes,
                others,
                level.size_px,
                padding=self.config.padding,
                occluder_weight=self.config.occluder_weight,
            )
            state = self._at_level(level, query, parts, state)
        return [
            self._ranked(self._parts[part], state.Ts_camera_part[mine], state.misfit[mine])
            for part, mine in ((part, state.detection == k) for k, part in enumerate(parts))
        ]

    def _at_level(self, level: AlignmentLevel, query: QueryMaps, parts: Sequence[str], state: _State) -> _State:
        """Refine all hypotheses of all parts at one level, part by part."""
        Ts_crop_camera = query.cameras.Ts_crop_camera[state.detection]
        Ts = Ts_crop_camera @ state.Ts_camera_part
        misfit = np.empty(len(Ts))
        for part in dict.fromkeys(parts):
            mine = np.flatnonzero(np.array([parts[k] == part for k in state.detection]))
            search = _LevelSearch(self._renderers, self._parts[part], level, query, state.detection[mine], self.config)
            minimum = minimise(Ts[mine], search.evaluate, level.iterations)
            Ts[mine], misfit[mine] = minimum.Ts_crop_part, minimum.misfit
        return _State(state.detection, invert(Ts_crop_camera) @ Ts, misfit)

    def _ranked(
        self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"], misfit: Float[np.ndarray, "n"]
    ) -> tuple[PoseHypothesis, ...]:
        scored = [
            PoseHypothesis(T, float(np.exp(-value / _SOFTNESS)))
            for T, value in zip(Ts_camera_part, misfit, strict=True)
        ]
        clusters = cluster_hypotheses(
            scored,
            part.symmetries,
            part.diameter_m,
            rotation_deg=self.config.merge_deg,
            translation_diameters=self.config.merge_diameters,
        )
        return tuple(cluster.best for cluster in clusters)


@dataclass(frozen=True, eq=False)
class _State:
    """All hypotheses of all detections between two levels."""

    detection: Int[np.ndarray, "n"]
    """Which detection each belongs to."""
    Ts_camera_part: Float[np.ndarray, "n 4 4"]
    misfit: Float[np.ndarray, "n"]

    @staticmethod
    def of(poses: Sequence[Sequence[Float[np.ndarray, "4 4"]]]) -> _State:
        """Return the start: the order of the hypotheses stands for their misfit."""
        detection = np.repeat(np.arange(len(poses)), [len(own) for own in poses])
        order = np.concatenate([np.arange(len(own)) for own in poses])
        return _State(detection, np.array([T for own in poses for T in own]), order.astype(float))

    def best(self, count: int) -> _State:
        """Return the `count` best hypotheses of each detection, in the order that they have."""
        order = np.lexsort([self.misfit, self.detection])
        first = np.searchsorted(self.detection[order], self.detection[order])
        kept = np.sort(order[np.arange(len(order)) - first < count])
        return _State(self.detection[kept], self.Ts_camera_part[kept], self.misfit[kept])


class _LevelSearch:
    """Renders and compares hypotheses of one part at one level."""

    def __init__(
        self,
        renderers: PartRenderers,
        part: Part,
        level: AlignmentLevel,
        query: QueryMaps,
        detection: Int[np.ndarray, "n"],
        config: RefinerConfig,
    ) -> None:
        self._renderers, self._part, self._level, self._config = renderers, part, level, config
        self._query, self._detection = query, detection

    def evaluate(self, Ts_crop_part: Float[np.ndarray, "m 4 4"], rows: Int[np.ndarray, "m"]) -> Alignment:
        """Return how well these poses of these rows fit."""
        of = self._detection[rows]
        query = self._query
        cameras = VirtualCameras(query.cameras.size_px, query.cameras.focal_px[of], query.cameras.Rs_crop_camera[of])
        depth_m = torch.from_numpy(self._renderers.depth(self._part, Ts_crop_part, cameras))
        origin_m = torch.from_numpy(Ts_crop_part[:, 2, 3]).float()
        focal_px = torch.from_numpy(cameras.focal_px).float()
        centres = torch.from_numpy(Ts_crop_part[:, :2, 3] / Ts_crop_part[:, 2:3, 3]).float()
        with torch.inference_mode():
            maps = query.brightness[of], query.mask[of], query.trust[of]
            target = Target(*maps, focal_px, self._level.blur_px, self._level.stride)
            return align(target, rendered_maps(depth_m, origin_m, focal_px), centres, self._config)


def _is_comparable(mask: Bool[np.ndarray, "height width"]) -> bool:
    if np.count_nonzero(mask) < _LEAST_MASK_PX:
        return False
    box = box_of_mask(mask)
    return bool((box[2:] - box[:2] >= 2).all())


def _is_sound(T_camera_part: Float[np.ndarray, "4 4"]) -> bool:
    """Return whether a pose is finite, a rotation, and before the camera."""
    R = T_camera_part[:3, :3]
    return bool(
        np.isfinite(T_camera_part).all() and T_camera_part[2, 3] > 0.02 and np.abs(R @ R.T - np.eye(3)).max() < 1e-3
    )
