"""Evidence for a pose in the image: what ranks poses, most of it independent of the detection's mask.

A mask can be wrong, and a pose that was fitted to it fits it. So poses are compared by the image's own edges: along
the rendered outline, and inside it against the edges of a rendering that is lit as the image is.

===================  ==================================================================================================
``outline_edges``    contrast across the rendered outline, where no other detection hides it
``inner_edges``      share of the image's edges inside the part that the rendering has too
``predicted_edges``  share of the rendering's edges that the image has too
``shading``          share of the part whose brightness the light explains
``mask``             overlap with the detection's mask, as -log(1.03 - overlap): a nearly perfect one is hardly chance
===================  ==================================================================================================
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from simpick.estimators.refiner.alignment import fit_light
from simpick.estimators.refiner.blurring import blur, central_differences, eroded
from simpick.estimators.refiner.query_maps import QueryMaps
from simpick.estimators.refiner.rendered_maps import RenderedMaps

_BLUR_PX = 1.0
_CONTRAST = 0.03
"""Change of brightness per pixel, relative to the part's mean, that counts as half an edge."""
_LEAST_OUTLINE = 0.05
_PRIOR = 0.5
"""Sum of contrasts that counts as disagreement: little texture is little evidence."""
_SHADING_SCALE = 0.1
_OVERLAP_FLOOR = 0.03


def evidence(query: QueryMaps, rendered: RenderedMaps) -> Float[Tensor, "n cues"]:
    """Return the cues of n poses in the order above; row k of `query` is the detection of row k of `rendered`."""
    covered, mask = rendered.silhouette, (query.mask > 0.5).float()
    free = (query.trust > 0.5).float()
    image = _Edges.of(blur(query.brightness, _BLUR_PX))

    nx, ny = central_differences(blur(covered, _BLUR_PX))
    length = (nx.square() + ny.square()).sqrt()
    seen = length * (length > _LEAST_OUTLINE) * eroded(free)
    share_seen = seen / length.clamp_min(1e-6)
    across = (share_seen * (nx * image.x + ny * image.y)).abs()
    outline = _total(across) / _total(seen).clamp_min(1e-3)

    core = eroded(covered)
    lit_core = core * eroded(mask)
    coloured = rendered.albedo * lit_core
    light = fit_light(coloured, rendered.normals * coloured[:, None], lit_core * query.brightness, _SHADING_SCALE)
    predicted = light[:, 0, None, None] + torch.einsum("nk,nkij->nij", light[:, 1:], rendered.normals)
    predicted = predicted * rendered.albedo
    smooth = blur(predicted * covered, _BLUR_PX) / blur(covered, _BLUR_PX).clamp_min(0.3)
    lit = _Edges.of(smooth)
    inside = eroded(core) * free
    agreement = inside * (lit.x * image.x + lit.y * image.y)
    inner = _total(agreement * image.contrast) / (_total(inside * image.contrast) + _PRIOR)
    foreseen = _total(agreement * lit.contrast) / (_total(inside * lit.contrast) + _PRIOR)

    residual = ((predicted - query.brightness) / _SHADING_SCALE).square()
    shaded = core * free
    shading = 1 - _total(residual / (1 + residual) * shaded) / _total(shaded).clamp_min(1)

    both = covered * mask
    union = _total((covered * free + mask - both * free).clamp(0, 1)).clamp_min(1)
    overlap = -(1 + _OVERLAP_FLOOR - _total(both) / union).log()
    return torch.stack([outline, inner, foreseen, shading, overlap], dim=1)


class _Edges:
    """Gradients whose length is saturated: what counts is whether and where an edge points."""

    def __init__(self, x: Tensor, y: Tensor, contrast: Tensor) -> None:
        self.x, self.y, self.contrast = x, y, contrast

    @staticmethod
    def of(brightness: Float[Tensor, "n size size"]) -> _Edges:
        x, y = central_differences(brightness)
        contrast = (x.square() + y.square()).sqrt()
        return _Edges(x / (contrast + _CONTRAST), y / (contrast + _CONTRAST), contrast)


def _total(maps: Float[Tensor, "n size size"]) -> Float[Tensor, "n"]:
    return maps.sum(dim=(1, 2))
