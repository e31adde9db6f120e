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
from simpick.training.data.batches import TrainingBatch, make_batch
from simpick.training.data.shard import Shard
from simpick.training.data.shard_stream import ShardStream

_PLAIN = AugmentationConfig(box_jitter=0.0, ragged_share=0.0, hidden_share=0.0, brightness=0.0)


class Validation:
    """Fixed held-out queries and templates."""

    def __init__(self, shards: Sequence[Shard], network: RayPoseConfig, config: TrainConfig) -> None:
        rng = np.random.default_rng([config.seed, 8])
        self._config = config
        self._shards = list(shards)
        self._batches = []
        for shard in self._shards:
            rows = rng.permutation(len(shard))[: config.validation_queries]
            self._batches.append(make_batch([shard], [rows], network, rng, augmentation=_PLAIN))

    @staticmethod
    def held_out(folder: Path, network: RayPoseConfig, config: TrainConfig) -> Validation:
        """Return the validation on held-out shards, which are made in `folder` where they are missing."""
        with ShardStream(folder, config.data, split="validation", workers=0, prefetch=0, keep=True) as stream:
            shards = [stream.get(index) for index in range(config.validation_shards)]
        return Validation(shards, network, config)

    @property
    def queries(self) -> int:
        """Return the number of queries."""
        return sum(len(batch) for batch in self._batches)

    def measure(self, model: RayPose, schedule: Schedule) -> dict[str, float]:
        """Return medians and recalls of sampled poses, with the number of templates of run time."""
        device = next(model.parameters()).device
        rotations, depths, centres = [], [], []
        model.eval()
        with torch.inference_mode():
            for shard, batch in zip(self._shards, self._batches, strict=True):
                R, centre, ratio = self._sample(model, batch.to(device), schedule)
                truth = batch.truth
                rotations.append(np.degrees(shard.symmetries.rotation_distance(R, truth.R[:, 0].double().numpy())))
                depths.append(np.abs(ratio - 1))
                centres.append(np.linalg.norm(centre - truth.centre[:, 0].numpy(), axis=-1))
        model.train()
        deg = np.concatenate(rotations)
        return {
            "rotation_deg": float(np.median(deg)),
            "below_5_deg": float((deg < 5).mean()),
            "below_15_deg": float((deg < 15).mean()),
            "below_30_deg": float((deg < 30).mean()),
            "depth_percent": 100 * float(np.median(np.concatenate(depths))),
            "centre_half_sides": float(np.median(np.concatenate(centres))),
        }

    def _sample(
        self, model: RayPose, batch: TrainingBatch, schedule: Schedule
    ) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        templates = model.fuse(model.encode_templates(batch.templates)).for_queries(batch.sets)
        conditioning = model.condition(model.encode_query(batch.query), templates)
        generator = torch.Generator().manual_seed(self._config.seed)
        views = sample_views(model, conditioning, schedule, self._config.validation_steps, generator)
        pose = consensus_pose(views)
        ratio = pose.half_extent_at_depth_m / batch.truth.half_extent_at_depth_m[:, 0]
        return pose.R.double().cpu().numpy(), pose.centre.cpu().numpy(), ratio.cpu().numpy()
