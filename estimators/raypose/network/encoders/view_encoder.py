"""The view encoder E_V: Fourier features of rotation map, translation map and box coordinates (paper, sec. 3.3.2).

Two departures from the paper: the embeddings are added to the image's tokens instead of concatenated with them, and
rotation and translation share one linear layer.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from simpick.estimators.raypose.network.pose_maps import ViewPoses, cell_centres, encode_offsets, encode_rotation


def fourier_features(x: Float[Tensor, "*batch channels"], bands: int) -> Float[Tensor, "*batch features"]:
    """Return gamma(x) = (x, sin(2 pi B x), cos(2 pi B x)) with B = 1/2, 1, 2, ...; (2 bands + 1) channels features."""
    if bands == 0:
        return x
    frequencies = math.pi * 2.0 ** torch.arange(bands, device=x.device, dtype=x.dtype)
    angles = (x[..., None] * frequencies).flatten(-2)
    return torch.cat([x, angles.sin(), angles.cos()], dim=-1)


class ViewEncoder(nn.Module):
    """Fourier encodings of where the crop looks, and for templates of the part's pose in it."""

    def __init__(self, cells: int, width: int, bands: int, padding: float) -> None:
        super().__init__()
        self.cells, self.bands, self.padding = cells, bands, padding
        per_channel = 2 * bands + 1
        self.box = nn.Linear(3 * per_channel, width)
        self.pose = nn.Linear(6 * per_channel, width)

    def encode_box(self, half_tangent: Float[Tensor, "batch"]) -> Float[Tensor, "batch tokens width"]:
        """Return an embedding of each cell's position in the box and of the box's angular size."""
        grid = cell_centres(self.cells, device=half_tangent.device).expand(len(half_tangent), -1, -1, -1)
        # Scaled to the order of one: crops span from 1 to 20 degrees.
        size = (half_tangent.log() / 4 + 0.75)[:, None, None, None].expand(*grid.shape[:-1], 1)
        boxes = torch.cat([grid * (self.padding / 2), size], dim=-1)  # (batch, cells, cells, 3)
        return self.box(fourier_features(boxes, self.bands)).flatten(1, 2)

    def encode_pose(self, views: ViewPoses, diameter_m: Float[Tensor, "batch"]) -> Float[Tensor, "batch tokens width"]:
        """Return an embedding of the part's pose for each cell; extents in diameters of the part."""
        rays = encode_rotation(views.R, self.cells)
        offsets = encode_offsets(views.centre, self.cells, self.padding)
        scale = (views.half_extent_at_depth_m / diameter_m).log()[:, None, None, None].expand(*rays.shape[:-1], 1)
        maps = torch.cat([rays, offsets, scale], dim=-1)  # (batch, cells, cells, 6)
        return self.pose(fourier_features(maps, self.bands)).flatten(1, 2)
