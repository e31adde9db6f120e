"""`TemplateIndex`: descriptors and poses of all templates of a part, and the search among them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.assets.part import Part
from simpick.caching import cache_dir, cache_key, cache_name, cached_arrays
from simpick.estimators.retrieval.descriptors import describe
from simpick.estimators.retrieval.turned_crops import aim_turned_crops, render_turned_crops
from simpick.geometry import SymmetryGroup, random_rotation
from simpick.rendering import TemplateConfig, load_templates, template_path

# Increment when the same templates would give other descriptors.
_VERSION = 2
_CANDIDATES = 32
"""Templates considered per hypothesis; those too close to better ones are dropped."""


@dataclass(frozen=True, eq=False)
class Matches:
    """The best templates for each of n queries, k each, best first."""

    templates: Int[np.ndarray, "n k"]
    scores: Float[np.ndarray, "n k"]
    """Similarity in [0, 1]."""
    Rs_crop_part: Float[np.ndarray, "n k 3 3"]
    """Smoothed over neighbouring templates."""
    centres: Float[np.ndarray, "n k 3"]
    """As `TemplateIndex.centres`, smoothed in the same way."""


class TemplateIndex:
    """The searchable templates of one part."""

    def __init__(
        self,
        descriptors: Float[Tensor, "templates dimensions"],
        Ts_crop_part: Float[np.ndarray, "templates 4 4"],
        focal_px: Float[np.ndarray, "templates"],
        symmetries: SymmetryGroup,
    ) -> None:
        """Take descriptors as `describe` makes them, and the poses in each template's own virtual camera."""
        self.descriptors = descriptors
        # Single precision halves the time of a search; its rounding is a thousand times finer than the answers.
        self.Rs_crop_part = Ts_crop_part[:, :3, :3].astype(np.float32)
        self.centres = Ts_crop_part[:, :3, 3].astype(np.float32)
        self.centres[:, 2] /= focal_px
        """Of the part's origin: x and y in metres, and depth in metres per pixel of focal length. The same in every
        virtual camera that makes the same crop from another distance."""
        self._symmetries = symmetries

    def __len__(self) -> int:
        return len(self.descriptors)

    def search(
        self,
        queries: Float[Tensor, "n dimensions"],
        count: int,
        *,
        spacing_rad: float,
        smoothing_rad: float,
        softness: float,
    ) -> Matches:
        """Return the `count` best templates for each query, no two closer than `spacing_rad` over the symmetries.

        Poses are averages over the templates within `smoothing_rad` of each match, weighted by
        ``exp(score / softness)``: similarity decreases evenly around the true view, which mostly lies
        between templates.
        """
        scores = (queries @ self.descriptors.T).numpy()
        templates = self._spread(scores, count, spacing_rad)
        flat = templates.ravel()
        # (n k templates): how close each template is to each match.
        flat_R = self.Rs_crop_part.reshape(-1, 9)
        cosine = (flat_R[flat] @ flat_R.T - 1) / 2
        near = cosine >= np.cos(smoothing_rad)
        # Rounding must not exclude a match from its own neighbourhood.
        near[np.arange(len(flat)), flat] = True
        rows, columns = np.nonzero(near)
        query = rows // count
        weights = np.zeros(near.shape, np.float32)
        best = scores[query, flat[rows]]
        weights[rows, columns] = np.exp(np.minimum(scores[query, columns] - best, 0) / softness)
        weights /= weights.sum(axis=1, keepdims=True)
        Rs = _closest_rotations((weights @ flat_R).reshape(-1, 3, 3))
        shape = templates.shape
        picked = np.take_along_axis(scores, templates, axis=1).astype(float)
        return Matches(
            templates, picked, Rs.reshape(*shape, 3, 3), (weights @ self.centres).astype(float).reshape(*shape, 3)
        )

    def _spread(
        self, scores: Float[np.ndarray, "n templates"], count: int, spacing_rad: float
    ) -> Int[np.ndarray, "n count"]:
        """Return the best templates that are far enough from one another, for all queries at once."""
        limit = min(max(_CANDIDATES * count, 256), scores.shape[1])
        candidates = np.argpartition(-scores, limit - 1, axis=1)[:, :limit]
        values = np.take_along_axis(scores, candidates, axis=1)
        forms = self._canonical[:, candidates]  # (references, n, candidates, 9)
        chosen = np.empty((len(scores), count), np.int64)
        row = np.arange(len(scores))
        # Templates that were excluded are chosen only when no others are left.
        left = values.copy()
        for k in range(count):
            best = left.argmax(axis=1)
            chosen[:, k] = candidates[row, best]
            cosine = ((forms * forms[:, row, best][:, :, None]).sum(axis=-1).max(axis=0) - 1) / 2
            left = np.where(cosine > np.cos(spacing_rad), left - 4.0, left)
        return chosen

    @cached_property
    def _canonical(self) -> Float[np.ndarray, "references templates 9"]:
        """Return each rotation in its equivalent form closest to a reference, for two references.

        Equivalent orientations have the same form, except where two symmetries are about equally close. That happens at
        other orientations for another reference, so two references suffice in practice.
        """
        references = np.stack([np.eye(3), random_rotation(np.random.default_rng(0))])
        Rs = self.Rs_crop_part.astype(float)
        forms = [Rs @ self._symmetries.closest_symmetry(np.swapaxes(Rs, 1, 2) @ R)[:, :3, :3] for R in references]
        return np.stack(forms).reshape(len(references), -1, 9).astype(np.float32)


def load_index(
    part: Part, config: TemplateConfig, turns: int, *, progress: Callable[[int, int], None] | None = None
) -> TemplateIndex:
    """Return a part's index, its descriptors from the cache if they are there; poses are computed each time."""
    templates = load_templates(part, config, progress=progress)
    crops = aim_turned_crops(templates, turns)
    key = cache_key(_VERSION, template_path(part, config).name, turns, torch.__version__)

    def describe_all() -> dict[str, np.ndarray]:
        described = [describe(gray, masks) for gray, masks in render_turned_crops(templates, crops)]
        return {"descriptors": torch.cat(described).half().numpy()}

    stored = cached_arrays(cache_dir() / "retrieval" / cache_name(part.name, key), ("descriptors",), describe_all)
    descriptors = torch.tensor(stored["descriptors"]).float()
    return TemplateIndex(descriptors, crops.Ts_crop_part, crops.focal_px, part.symmetries)


def _closest_rotations(M: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Return the rotations closest to these matrices (orthogonal Procrustes)."""
    U, _, Vt = np.linalg.svd(M.astype(float))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    return U @ Vt
