"""Validation by sampled poses of held-out parts; the loss alone can fall while poses stay at chance level."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from simpick.estimators.raypose.diffusion.schedule import Schedule
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.consensus import consensus_pose
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.sample_views import sample_views
from simpick.training.config import TrainConfig
from simpick.training.data.augmentation import AugmentationConfig
from simpick.training.data.batches import TrainingBatch, block_diagonal, make_batch
from simpick.training.data.shard import Shard
from simpick.training.data.shard_stream import ShardStream

_RIGHT_MASKS = AugmentationConfig(
    box_jitter=0.0, box_share=0.0, merged_share=0.0, hidden_share=0.0, hole_share=0.0, ragged_share=0.0, brightness=0.0
)
_WRONG_MASKS = AugmentationConfig(brightness=0.0)


class Validation:
    """Fixed held-out queries and templates."""

    def __init__(self, shards: Sequence[Shard], network: RayPoseConfig, config: TrainConfig) -> None:
        self._config = config
        self._shards = list(shards)
        self._right, self._wrong = (
            [
                make_batch([shard], [rows], network, rng, augmentation=augmentation)
                for shard in self._shards
                for rows in [rng.permutation(len(shard))[: config.validation_queries]]
            ]
            for augmentation in (_RIGHT_MASKS, _WRONG_MASKS)
            for rng in [np.random.default_rng([config.seed, 8])]
        )

    @staticmethod
    def held_out(folder: Path, network: RayPoseConfig, config: TrainConfig) -> Validation:
        """Return the validation on held-out shards, which are made in `folder` where they are missing."""
        with ShardStream(folder, config.data, split="validation", workers=0, prefetch=0, keep=True) as stream:
            shards = [stream.get(index) for index in range(config.validation_shards)]
        return Validation(shards, network, config)

    @property
    def queries(self) -> int:
        """Return the number of queries."""
        return sum(len(batch) for batch in self._right)

    def measure(self, model: RayPose, schedule: Schedule) -> dict[str, float]:
        """Return medians and recalls of poses, with the number of templates of run time.

        They are those of matches and flow, as at run time, and those that are denoised from there: `denoised_...`; a
        network without matching only has the latter. `wrong_masks_...`: the same queries with masks as wrong as in
        training.
        """
        sampled = self.measure_denoised(model, schedule)
        if not model.solves_matches:
            return sampled
        figures = self._errors(model, self._right, None)
        wrong = self._errors(model, self._wrong, None)
        kept = ("rotation_deg", "depth_percent")
        figures |= {f"denoised_{name}": sampled[name] for name in kept}
        figures |= {f"wrong_masks_{name}": wrong[name] for name in (*kept, "below_15_deg")}
        return figures | {"view_deg": self._view_error(model)}

    def measure_denoised(self, model: RayPose, schedule: Schedule) -> dict[str, float]:
        """Return medians and recalls of poses that the decoder denoises, with right masks."""
        return self._errors(model, self._right, schedule)

    def _view_error(self, model: RayPose) -> float:
        """Return the median rotation in degrees of the view that each query's embedding chooses, with wrong masks.

        It chooses among all templates of all queries: there is one near to each query.
        """
        device = next(model.parameters()).device
        with torch.inference_mode():
            batches = [batch.to(device) for batch in self._wrong]
            queries = torch.cat([model.encode_query(batch.query).embedding for batch in batches])
            views = torch.cat([model.encode_templates(b.templates).embedding.flatten(0, 1) for b in batches])
            chosen = model.view_embedding.logits(queries, views).argmax(dim=1).cpu().numpy()
        angles = block_diagonal([batch.view_angles_rad.numpy() for batch in self._wrong], np.pi)
        return float(np.median(np.degrees(angles[np.arange(len(chosen)), chosen])))

    def _errors(self, model: RayPose, batches: Sequence[TrainingBatch], schedule: Schedule | None) -> dict[str, float]:
        """Return the figures of denoised poses, or without a schedule those of matches and flow."""
        device = next(model.parameters()).device
        rotations, depths, centres = [], [], []
        was_training = model.training
        model.eval()
        with torch.inference_mode():
            for shard, batch in zip(self._shards, batches, strict=True):
                R, centre, ratio = self._poses(model, batch.to(device), schedule)
                truth = batch.truth
                rotations.append(np.degrees(shard.symmetries.rotation_distance(R, truth.R[:, 0].double().numpy())))
                depths.append(np.abs(ratio - 1))
                centres.append(np.linalg.norm(centre - truth.centre[:, 0].numpy(), axis=-1))
        model.train(was_training)
        deg = np.concatenate(rotations)
        return {
            "rotation_deg": float(np.median(deg)),
            "below_5_deg": float((deg < 5).mean()),
            "below_15_deg": float((deg < 15).mean()),
            "below_30_deg": float((deg < 30).mean()),
            "depth_percent": 100 * float(np.median(np.concatenate(depths))),
            "centre_half_sides": float(np.median(np.concatenate(centres))),
        }

    def _poses(
        self, model: RayPose, batch: TrainingBatch, schedule: Schedule | None
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        query, templates = model.encode_query(batch.query), model.encode_templates(batch.templates)
        if schedule is None:
            templates = templates.for_queries(batch.sets)
            pose = consensus_pose(model.initial_poses(query, templates).poses.views(templates.diameter_m))
        else:
            conditioning = model.condition(query, model.fuse(templates).for_queries(batch.sets))
            generator = torch.Generator().manual_seed(self._config.seed)
            pose = consensus_pose(sample_views(model, conditioning, schedule, self._config.validation_steps, generator))
        ratio = pose.half_extent_at_depth_m / batch.truth.half_extent_at_depth_m[:, 0]
        return pose.R.double().cpu().numpy(), pose.centre.cpu().numpy(), ratio.cpu().numpy()
