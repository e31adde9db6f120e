"""`ViewIndex`: the embeddings of all views of a part in many turns, and the search for those that a query resembles."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from simpick.assets.part import Part
from simpick.caching import cache_dir, cache_key, cache_name, cached_arrays
from simpick.estimators.pose_selection import distinct_poses
from simpick.estimators.raypose.crops.aimed_templates import AimedTemplates, aim_at_templates
from simpick.estimators.raypose.crops.template_crops import TemplateImages, sample_templates
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.rendering import TemplateSet
from simpick.tensor_record import TensorRecord

TURNS = 12
_VERSION = 1
_AT_ONCE = 64
_CONSIDERED = 64
"""Most similar views that distinct poses are chosen from."""
_SPACING_DEG = 20.0


@dataclass(frozen=True, eq=False)
class ViewIndex(TensorRecord):
    """What the network keeps of the views of one part, in each turn about the optical axis."""

    embeddings: Float[Tensor, "views embedding"]
    poses: ViewPoses

    def search(
        self,
        model: RayPose,
        part: Part,
        embeddings: Float[Tensor, "n embedding"],
        half_tangents: Float[Tensor, "n"],
        count: int,
    ) -> list[tuple[Float[np.ndarray, "_ 4 4"], Float[np.ndarray, "_"]]]:
        """Return for each query the poses in its crop of up to `count` views, and the logarithms of their odds.

        Poses differ by 20 degrees or more, over the part's symmetries, best first.
        """
        logits = model.view_embedding.logits(embeddings, self.embeddings)
        found = []
        for row, half_tangent in zip(logits, half_tangents, strict=True):
            best = row.topk(min(_CONSIDERED, len(row)))
            poses = self.poses.rows(best.indices).map(Tensor.double)
            Ts = poses.pose(half_tangent.double().expand(len(best.indices)))
            scores = best.values.numpy().astype(float)
            kept = distinct_poses(
                Ts.numpy(),
                scores,
                part.symmetries,
                part.diameter_m,
                rotation_deg=_SPACING_DEG,
                translation_diameters=np.inf,
                count=count,
            )
            found.append((Ts.numpy()[kept], scores[kept]))
        return found


def load_view_index(model: RayPose, part: Part, templates: TemplateSet) -> ViewIndex:
    """Return a part's index for a network, from the cache where it is there."""
    views = np.repeat(np.arange(len(templates)), TURNS)
    angles = np.tile(2 * np.pi * np.arange(TURNS) / TURNS, len(templates))
    aimed = aim_at_templates(templates, views, angles, model.config)

    def embed() -> dict[str, np.ndarray]:
        images = TemplateImages.of(templates)
        with torch.inference_mode():
            parts = [_embed(model, images, aimed.rows(slice(k, k + _AT_ONCE))) for k in range(0, len(aimed), _AT_ONCE)]
        return {"embeddings": torch.cat(parts).numpy()}

    key = cache_key(_VERSION, TURNS, part.content_hash, _weights_hash(model), templates.rgb.tobytes())
    arrays = cached_arrays(cache_dir() / "views" / cache_name(part.name, key), ("embeddings",), embed)
    half_tangent = torch.tensor(aimed.recrops.half_tangent, dtype=torch.float32)
    poses = ViewPoses.of(torch.tensor(aimed.Ts_crop_part, dtype=torch.float32), half_tangent)
    return ViewIndex(torch.tensor(arrays["embeddings"]), poses)


def _embed(model: RayPose, images: TemplateImages, aimed: AimedTemplates) -> Float[Tensor, "n embedding"]:
    sampled = sample_templates(images, aimed)
    return model.embed_views(sampled[:, :3], sampled[:, 3])


def _weights_hash(model: RayPose) -> str:
    digest = hashlib.sha256()
    for module in (model.image_encoder, model.view_embedding):
        for tensor in module.state_dict().values():
            digest.update(tensor.cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
