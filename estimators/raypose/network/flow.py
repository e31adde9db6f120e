"""Flow: how far each place of the nearest templates is from where the matched pose says, and the pose that follows.

Not in the paper. Matching finds for each query cell a place anywhere on the part, and is as coarse as its cells; here
template cells half as wide are looked for only near where they should appear, as in optical flow: correlations with all
query cells once, read around the expected place (Teed and Deng, RAFT, ECCV 2020), each with its own 2 x 2 information,
since an edge tells nothing along itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, project, solve_poses

MIN_COVERAGE = 0.3
"""Cells of which the part covers less take no part, in templates and in the query."""
_ITERATIONS = 3
_DAMPING = 2e-3
_HIDDEN = 32
_LOG_BOUNDS = (-6.0, 4.0)
"""Of the diagonal of a square root of information."""


@dataclass(frozen=True, eq=False)
class FlowCells:
    """Cells of templates, half as wide as those that are matched."""

    descriptors: Float[Tensor, "batch views cells width"]
    points: Float[Tensor, "batch views cells 3"]
    """Mean position in the part's frame of what each cell shows, in diameters; 0 where it shows nothing."""
    coverage: Float[Tensor, "batch views cells"]

    def nearer_half(self, Rs_view_part: Float[Tensor, "batch views 3 3"], R: Float[Tensor, "batch 3 3"]) -> FlowCells:
        """Return the cells of those views that are turned less against a pose than the others."""
        count = (Rs_view_part.shape[1] + 1) // 2
        order = torch.einsum("bkij,bij->bk", Rs_view_part, R).topk(count, dim=1).indices

        def chosen(x: Tensor) -> Tensor:
            return torch.take_along_dim(x, order.view(*order.shape, *[1] * (x.ndim - 2)), dim=1)

        return FlowCells(chosen(self.descriptors), chosen(self.points), chosen(self.coverage))


@dataclass(frozen=True, eq=False)
class Flow:
    """What was found around a first pose; cells are those of the nearest templates, one template after the other."""

    points: Float[Tensor, "batch cells 3"]
    """Of the templates' cells."""
    valid: Bool[Tensor, "batch cells"]
    """Whether a template's cell shows the part, and the query does where it should appear."""
    expected: Float[Tensor, "batch cells 2"]
    """Where each should appear, in half crop sides."""
    log_probabilities: Float[Tensor, "batch cells offsets"]
    """Of the offsets around there."""
    offset: Float[Tensor, "batch cells 2"]
    """How far from there each seems to be."""
    pose: SolvedPoses
    """The pose that follows, one view."""


class TemplateFlow(nn.Module):
    """Descriptors of narrow cells, and a small network that reads correlations."""

    offsets: Tensor

    def __init__(self, config: RayPoseConfig, narrow: int) -> None:
        """`narrow` is the image encoder's number of channels at half the matched cells' width."""
        super().__init__()
        width, self.side = config.flow_width, config.flow_cells
        self.from_narrow = nn.Conv2d(narrow, width, 1)
        self.from_wide = nn.Conv2d(config.local_width, width, 1)
        self.join = nn.Conv2d(width, width, 3, 1, 1)
        self.log_temperature = nn.Parameter(torch.tensor(math.log(10.0)))
        axis = torch.arange(-config.flow_radius, config.flow_radius + 1) * self.unit
        y, x = torch.meshgrid(axis, axis, indexing="ij")
        self.register_buffer("offsets", torch.stack([x, y], dim=-1).flatten(0, 1), persistent=False)  # (offsets, 2)
        self.read = nn.Sequential(
            nn.Conv2d(len(self.offsets) + width + 4, _HIDDEN, 3, 1, 1),
            nn.ReLU(),
            nn.Conv2d(_HIDDEN, _HIDDEN, 1),
            nn.ReLU(),
            nn.Conv2d(_HIDDEN, 5, 1),
        )
        nn.init.zeros_(self.read[-1].weight)  # pyright: ignore[reportArgumentType]
        nn.init.zeros_(self.read[-1].bias)  # pyright: ignore[reportArgumentType]

    @property
    def unit(self) -> float:
        """Return the width of a cell in half crop sides."""
        return 2 / self.side

    def describe(
        self, narrow: Float[Tensor, "batch narrow side side"], wide: Float[Tensor, "batch wide h w"]
    ) -> Float[Tensor, "batch cells width"]:
        """Return one descriptor of unit length for each cell, row by row."""
        wide = F.interpolate(self.from_wide(wide), scale_factor=2, mode="bilinear", align_corners=False)
        x = self.join(F.relu(self.from_narrow(narrow) + wide))
        return F.normalize(x.flatten(2).mT, dim=-1)

    def forward(
        self,
        query: Float[Tensor, "batch cells width"],
        query_coverage: Float[Tensor, "batch cells"],
        templates: FlowCells,
        half_tangent: Float[Tensor, "batch"],
        start: SolvedPoses,
    ) -> Flow:
        """Return flow and pose around a first pose of one view, which gets no gradient."""
        # In single precision, whatever the network around runs in: half a cell must not be lost to rounding.
        with torch.autocast(query.device.type, enabled=False):
            pose = SolvedPoses(*(getattr(start, name).detach() for name in ("R", "centre", "log_scale", "residuals")))
            batch, views = templates.coverage.shape[:2]
            points = templates.points.float().flatten(1, 2)  # (batch, all cells, 3)
            expected = project(points, half_tangent, pose)[0][:, 0]  # (batch, all cells, 2)
            descriptors = templates.descriptors.float().flatten(1, 2)
            volume = (descriptors @ query.float().mT).unflatten(
                -1, (self.side, self.side)
            )  # (batch, all cells, side, side)
            around = expected[:, :, None] + self.offsets  # (batch, all cells, offsets, 2)
            # Between cells, correlations are interpolated, which is the correlation with interpolated descriptors.
            cosine = F.grid_sample(
                volume.flatten(0, 1)[:, None], around.flatten(0, 1)[:, None], padding_mode="border", align_corners=False
            )[:, 0, 0].unflatten(0, (batch, -1))  # (batch, all cells, offsets)
            mask = query_coverage.float().unflatten(-1, (1, self.side, self.side))
            there = F.grid_sample(mask, expected[:, None], align_corners=False)[:, 0, 0]  # (batch, all cells)
            log_probabilities = (cosine * self.log_temperature.exp().clamp(max=100.0)).log_softmax(dim=-1)
            mean = log_probabilities.exp() @ self.offsets
            coverage = templates.coverage.float().flatten(1, 2)
            features = torch.cat(
                [cosine, mean / self.unit, there[..., None], coverage[..., None], descriptors], dim=-1
            )  # (batch, all cells, features)
            maps = features.unflatten(1, (views, self.side * self.side)).flatten(0, 1).mT
            out = self.read(maps.unflatten(-1, (self.side, self.side)))  # (batch * views, 5, side, side)
            out = out.flatten(2).mT.reshape(batch, -1, 5)
            offset = mean + out[..., :2] * self.unit
            valid = (coverage > MIN_COVERAGE) & (there > MIN_COVERAGE)
            solved = solve_poses(
                points,
                expected + offset,
                valid.float(),
                half_tangent,
                pose,
                _ITERATIONS,
                whitening=_upper_triangular(out[..., 2:]),
                damping=_DAMPING,
            )
            return Flow(points, valid, expected, log_probabilities, offset, solved)


def _upper_triangular(x: Float[Tensor, "batch cells 3"]) -> Float[Tensor, "batch cells 2 2"]:
    """Return a square root of each cell's information: logarithms of the diagonal, and what is off it."""
    x_x, y_y = x[..., :2].clamp(*_LOG_BOUNDS).exp().unbind(dim=-1)
    rows = [torch.stack([x_x, x[..., 2]], dim=-1), torch.stack([torch.zeros_like(y_y), y_y], dim=-1)]
    return torch.stack(rows, dim=-2)
