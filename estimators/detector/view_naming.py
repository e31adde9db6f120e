"""A second opinion on names: the pose network's embeddings of views, which it learned to tell views and parts apart by.

They see shading and texture where retrieval descriptors see edges and outline, and know nothing of distance, so the two
err in different cases.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from simpick.assets.part import Part
from simpick.estimators.raypose.checkpoints import load_checkpoint, shipped_checkpoint
from simpick.estimators.raypose.crops.query_crops import crop_queries
from simpick.estimators.raypose.view_index import load_view_index
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame
from simpick.rendering import load_templates


class ViewNaming:
    """Compares instances with all views of the parts; parts are onboarded when they are first asked for."""

    def __init__(self) -> None:
        """Load the shipped pose network.

        Raises:
            CheckpointError: the weights are missing or damaged.
        """
        self._model = load_checkpoint(shipped_checkpoint()).model
        self._embeddings: dict[str, Float[Tensor, "views embedding"]] = {}

    def onboard(self, part: Part) -> None:
        """Embed the part's views, or take them from the cache on disk, which pose estimation shares."""
        if part.content_hash not in self._embeddings:
            index = load_view_index(self._model, part, load_templates(part))
            self._embeddings[part.content_hash] = index.embeddings

    def compare(
        self, frame: CameraFrame, masks: Sequence[Bool[np.ndarray, "height width"]], parts: Sequence[Part]
    ) -> Float[np.ndarray, "instances parts"]:
        """Return the logarithms of the odds of each part, but for a constant per instance; there must be a mask.

        All views of a part are equally probable.
        """
        for part in parts:
            self.onboard(part)
        queries = crop_queries(frame, masks, np.stack([box_of_mask(mask) for mask in masks]), self._model.config)
        with torch.inference_mode():
            embeddings = self._model.embed_views(queries.inputs.rgb, queries.inputs.masks)
            odds = []
            for part in parts:
                views = self._embeddings[part.content_hash]
                logits = self._model.view_embedding.logits(embeddings, views)
                odds.append(logits.logsumexp(dim=1) - math.log(len(views)))
            return torch.stack(odds, dim=1).double().numpy()
