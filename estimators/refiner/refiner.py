"""`Refiner`: aligns renderings with the image and ranks hypotheses by their fit. No training, no weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.estimators.pose_selection import best_per_group, distinct_poses
from simpick.estimators.refiner.alignment import Alignment, Target, align
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.estimators.refiner.levenberg_marquardt import minimise
from simpick.estimators.refiner.query_maps import QueryMaps, query_maps
from simpick.estimators.refiner.rendered_maps import rendered_maps
from simpick.estimators.valid_detections import check_onboarded, detection_mask, has_shape
from simpick.geometry import VirtualCameras, box_of_mask, invert
from simpick.records import CameraFrame, Detection, PoseHypothesis
from simpick.rendering import RenderQuality
from simpick.rendering.part_renderers import PartRenderers
from simpick.tensor_record import TensorRecord

_SOFTNESS = 0.35
"""Misfit at which the score is 1/e."""
_LEAST_MASK_PX = 16
_DEPTH_ONLY = RenderQuality(shadow_map_px=0, samples=0)


class Refiner(Closing):
    """Improves hypotheses until renderings of the part match the image; see `alignment`.

    Implements `PoseRefiner`. A context manager: `close` frees its OpenGL contexts.
    """

    def __init__(self, config: RefinerConfig | None = None) -> None:
        self.config = config or RefinerConfig()
        self._parts: dict[str, Part] = {}
        self._renderers = PartRenderers(self.config.renderers, quality=_DEPTH_ONLY)

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

        Scores are in (0, 1]: exp(-misfit / 0.35). Hypotheses that are not rotation matrices, not finite, or behind the
        camera are ignored. A detection without valid hypotheses, or with a mask of fewer than 16 pixels or a single
        line of them, gets its hypotheses back unchanged.

        Raises:
            ConfigError: there are not as many lists of hypotheses as detections, or a mask is not of the image's size.
            UnknownNameError: a detection's part has not been onboarded.
        """
        if len(hypotheses) != len(detections):
            raise ConfigError(
                f"there must be one list of hypotheses for each detection, got {len(hypotheses)} for {len(detections)}"
            )
        check_onboarded(detections, self._parts)
        masks = [detection_mask(detection, frame) for detection in detections]
        usable = [[h for h in own if _is_valid(h.T_camera_part)] for own in hypotheses]
        rows = [k for k, mask in enumerate(masks) if usable[k] and has_shape(mask, _LEAST_MASK_PX)]
        answers = [tuple(own) for own in hypotheses]
        if rows:
            refined = self._refine(frame, masks, [detections[k].part for k in rows], rows, [usable[k] for k in rows])
            for k, best_first in zip(rows, refined, strict=True):
                answers[k] = best_first
        return answers

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self._renderers.close()

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
        queries = [
            query_maps(
                frame,
                own,
                boxes,
                others,
                level.size_px,
                padding=self.config.padding,
                occluder_weight=self.config.occluder_weight,
            )
            for level in self.config.levels
        ]
        answers: list[tuple[PoseHypothesis, ...]] = [()] * len(rows)
        # Part by part through all levels, so that no renderer is opened again at each level if there are many parts.
        for part in dict.fromkeys(parts):
            mine = [k for k, name in enumerate(parts) if name == part]
            state = _State.of(mine, [[h.T_camera_part for h in hypotheses[k]] for k in mine])
            for level, query in zip(self.config.levels, queries, strict=True):
                state = self._at_level(level, query, self._parts[part], state.best(level.keep))
                state = self._distinct(self._parts[part], state)
            for k in mine:
                of_k = np.flatnonzero(state.detection == k)
                scored = [
                    PoseHypothesis(state.Ts_camera_part[i], float(np.exp(-state.misfit[i] / _SOFTNESS))) for i in of_k
                ]
                answers[k] = tuple(sorted(scored, key=lambda hypothesis: -hypothesis.score))
        return answers

    def _at_level(self, level: AlignmentLevel, query: QueryMaps, part: Part, state: _State) -> _State:
        """Refine all hypotheses of one part at one level."""
        Ts_crop_camera = query.cameras.Ts_crop_camera[state.detection]
        search = _LevelSearch(self._renderers, part, level, query, state.detection, self.config)
        minimum = minimise(Ts_crop_camera @ state.Ts_ahead, search.evaluate, level.iterations)
        Ts_camera_crop = invert(Ts_crop_camera)
        return _State(
            state.detection, Ts_camera_crop @ minimum.Ts_crop_part, Ts_camera_crop @ minimum.Ts_ahead, minimum.misfit
        )

    def _distinct(self, part: Part, state: _State) -> _State:
        """Return the hypotheses without those that converged to the pose of a better one of the same detection."""
        kept = []
        for k in np.unique(state.detection):
            own = np.flatnonzero(state.detection == k)
            distinct = distinct_poses(
                state.Ts_camera_part[own],
                -state.misfit[own],
                part.symmetries,
                part.diameter_m,
                rotation_deg=self.config.merge_deg,
                translation_diameters=self.config.merge_diameters,
            )
            kept.append(own[distinct])
        return state.rows(np.sort(np.concatenate(kept)))


@dataclass(frozen=True, eq=False)
class _State(TensorRecord):
    """The hypotheses of one part's detections between two levels."""

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

    def best(self, count: int) -> _State:
        """Return the `count` best hypotheses of each detection, in their present order."""
        return self.rows(np.sort(best_per_group(self.detection, self.misfit, count)))


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
        self._renderers, self._part, self._config = renderers, part, config
        self._cameras, self._detection = query.cameras, detection
        # Maps of this part's detections only; each detection has several hypotheses.
        own, self._row = np.unique(detection, return_inverse=True)
        focal_px = torch.from_numpy(query.cameras.focal_px[own]).float()
        with torch.inference_mode():
            maps = query.brightness[own], query.mask[own], query.trust[own]
            self._target = Target.of(*maps, focal_px, level.blur_px, level.stride)

    def evaluate(self, Ts_crop_part: Float[np.ndarray, "m 4 4"], rows: Int[np.ndarray, "m"]) -> Alignment:
        """Return how well these poses fit; `rows` says whose they are."""
        of = self._detection[rows]
        cameras = VirtualCameras(self._cameras.size_px, self._cameras.focal_px[of], self._cameras.Rs_crop_camera[of])
        largest_px = max(level.size_px for level in self._config.levels)
        renderer = self._renderers.get(self._part, largest_px, largest_px)
        pinholes = [cameras.pinhole(k) for k in range(len(cameras))]
        depth_m = torch.from_numpy(renderer.render(Ts_crop_part, pinholes, rgb=False).depth_m)
        origin_m = torch.from_numpy(Ts_crop_part[:, 2, 3]).float()
        centres = torch.from_numpy(Ts_crop_part[:, :2, 3] / Ts_crop_part[:, 2:3, 3]).float()
        with torch.inference_mode():
            target = self._target.rows(torch.from_numpy(self._row[rows]))
            return align(target, rendered_maps(depth_m, origin_m, target.focal_px), centres, self._config)


def _is_valid(T_camera_part: Float[np.ndarray, "4 4"]) -> bool:
    """Return whether a pose is finite, a rotation, and in front of the camera."""
    R = T_camera_part[:3, :3]
    return bool(
        np.isfinite(T_camera_part).all() and T_camera_part[2, 3] > 0.02 and np.abs(R @ R.T - np.eye(3)).max() < 1e-3
    )
