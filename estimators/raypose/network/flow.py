"""Flow: the offset of each fine template cell from its expected projection, and the pose that follows.

Not in the paper. Matching finds for each query cell a point anywhere on the part and is as coarse as its cells. Here
template cells of half the width are searched for only around their expected projections, as in optical flow:
correlations with all query cells are computed once and read around each projection (Teed and Deng, RAFT, ECCV 2020).
They are computed only for cells that show the part, and for their neighbours, which are read with them.
Each offset has its own 2 x 2 information matrix, because an edge constrains only the direction across it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.estimators.raypose.network.cell_subset import CellSubset, select_rows
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.pose_solver import SolvedPoses, project, solve_poses
from simpick.tensor_record import TensorRecord

MIN_COVERAGE = 0.3
"""Cells that the part covers less are ignored, in templates and in the query."""
_ITERATIONS = 3
_DAMPING = 2e-3
_HIDDEN = 32
_LOG_BOUNDS = (-6.0, 4.0)
"""Of the diagonal of a square root of information."""


@dataclass(frozen=True, eq=False)
class FlowCells(TensorRecord):
    """Cells of templates on the fine level: half as wide as those that are matched."""

    descriptors: Float[Tensor, "*batch cells width"]
    points: Float[Tensor, "*batch cells 3"]
    """Mean position in the part's frame of what each cell shows, in diameters; 0 where it shows nothing."""
    coverage: Float[Tensor, "*batch cells"]

    def nearer_half(self, Rs_view_part: Float[Tensor, "batch views 3 3"], R: Float[Tensor, "batch 3 3"]) -> FlowCells:
        """Return the cells of the half of the views, rounded up, that are rotated least against `R`.

        Leading dimensions are (batch, views).
        """
        count = (Rs_view_part.shape[1] + 1) // 2
        order = torch.einsum("bkij,bij->bk", Rs_view_part, R).topk(count, dim=1).indices
        return self.map(lambda x: select_rows(x, order))


@dataclass(frozen=True, eq=False)
class Flow(TensorRecord):
    """What was measured around a pose; cells are those of the nearest templates, one template after the other."""

    points: Float[Tensor, "batch cells 3"]
    """Of the templates' cells."""
    valid: Bool[Tensor, "batch cells"]
    """Whether the cell shows the part, and the query's mask covers its expected projection."""
    expected: Float[Tensor, "batch cells 2"]
    """Projection of the cell's point in the given pose, in half crop sides."""
    log_probabilities: Float[Tensor, "batch cells offsets"]
    """Of the offsets around there."""
    offset: Float[Tensor, "batch cells 2"]
    """Measured offset from there."""
    pose: SolvedPoses
    """The pose that follows, as one view."""


class TemplateFlow(nn.Module):
    """Descriptors on the fine level, and a small network that reads their correlations."""

    offsets: Tensor

    def __init__(self, config: RayPoseConfig, fine_width: int) -> None:
        """`fine_width` is the image encoder's number of channels on the fine level."""
        super().__init__()
        width, self.side = config.flow_width, config.flow_cells
        self.from_fine = nn.Conv2d(fine_width, width, 1)
        self.from_coarse = nn.Conv2d(config.local_width, width, 1)
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
        for parameter in self.read[-1].parameters():
            nn.init.zeros_(parameter)

    @property
    def unit(self) -> float:
        """Return the width of a cell in half crop sides."""
        return 2 / self.side

    def describe(
        self, fine: Float[Tensor, "batch fine side side"], coarse: Float[Tensor, "batch coarse h w"]
    ) -> Float[Tensor, "batch cells width"]:
        """Return one descriptor of unit length per cell, row by row."""
        coarse = F.interpolate(self.from_coarse(coarse), scale_factor=2, mode="bilinear", align_corners=False)
        x = self.join(F.relu(self.from_fine(fine) + coarse))
        return F.normalize(x.flatten(2).mT, dim=-1)

    def forward(
        self,
        query: Float[Tensor, "batch cells width"],
        query_coverage: Float[Tensor, "batch cells"],
        templates: FlowCells,
        half_tangent: Float[Tensor, "batch"],
        start: SolvedPoses,
    ) -> Flow:
        """Return flow and pose around a start of one view, which gets no gradient."""
        # In single precision, also where the network runs in another: rounding must not lose half a cell.
        with torch.autocast(query.device.type, enabled=False):
            views, start = templates.coverage.shape[1], start.map(Tensor.detach)
            cells = templates.map(lambda x: x.float().flatten(1, 2))  # (batch, all cells, ...)
            expected = project(cells.points, half_tangent, start)[0][:, 0]  # (batch, all cells, 2)
            near = CellSubset.of(self._shows_or_touches(cells.coverage))
            kept = self._correlations(query.float(), near.take(cells.descriptors), near.take(expected))
            cosine = near.put(kept, cells.coverage.shape[1])  # (batch, all cells, offsets)
            log_probabilities = (cosine * self.log_temperature.exp().clamp(max=100.0)).log_softmax(dim=-1)
            mean = log_probabilities.exp() @ self.offsets
            mask = query_coverage.float().unflatten(-1, (1, self.side, self.side))
            there = F.grid_sample(mask, expected[:, None], align_corners=False)[:, 0, 0]  # (batch, all cells)
            read = self._read(
                torch.cat(
                    [cosine, mean / self.unit, there[..., None], cells.coverage[..., None], cells.descriptors], dim=-1
                ),
                views,
            )  # (batch, all cells, 5)
            offset = mean + read[..., :2] * self.unit
            valid = (cells.coverage > MIN_COVERAGE) & (there > MIN_COVERAGE)
            useful = CellSubset.of(valid)
            pose = solve_poses(
                useful.take(cells.points),
                useful.take(expected + offset),
                useful.take(valid).float(),
                half_tangent,
                start,
                _ITERATIONS,
                whitening=_upper_triangular(useful.take(read[..., 2:])),
                damping=_DAMPING,
            )
            return Flow(cells.points, valid, expected, log_probabilities, offset, pose)

    def _correlations(
        self,
        query: Float[Tensor, "batch query_cells width"],
        descriptors: Float[Tensor, "batch cells width"],
        expected: Float[Tensor, "batch cells 2"],
    ) -> Float[Tensor, "batch cells offsets"]:
        """Return the cosines of each cell with the query at the offsets around its expected projection."""
        volume = descriptors @ query.mT  # (batch, cells, query cells)
        # All offsets of a cell lie between the same query cells' centres, so a window of these has all that is needed.
        reach = math.isqrt(len(self.offsets)) + 1
        first = expected / self.unit + (self.side - reach + 1) / 2  # (batch, cells, 2), in cells
        low = first.clamp(-reach, self.side).floor()
        x, y = (low[..., None] + torch.arange(reach, device=low.device)).long().clamp(0, self.side - 1).unbind(dim=-2)
        window = volume.gather(-1, (y[..., None] * self.side + x[..., None, :]).flatten(-2)).unflatten(-1, (reach, -1))
        # Between cells, correlations are interpolated, which is the correlation with interpolated descriptors.
        fx, fy = (first - low).clamp(0, 1)[..., None, None].unbind(dim=-3)
        rows = window[..., :-1].lerp(window[..., 1:], fx)
        return rows[..., :-1, :].lerp(rows[..., 1:, :], fy).flatten(-2)

    def _shows_or_touches(self, coverage: Float[Tensor, "batch cells"]) -> Bool[Tensor, "batch cells"]:
        """Return which cells show the part or are beside such a cell of the same template."""
        maps = (coverage > MIN_COVERAGE).float().view(len(coverage), -1, self.side, self.side)
        return F.max_pool2d(maps, 3, 1, 1).flatten(1) > 0

    def _read(self, features: Float[Tensor, "batch cells features"], views: int) -> Float[Tensor, "batch cells 5"]:
        """Return for each cell a correction of its offset (2, in cells) and its information (3)."""
        maps = features.unflatten(1, (views, -1)).flatten(0, 1).mT.unflatten(-1, (self.side, self.side))
        return self.read(maps).flatten(2).mT.reshape(len(features), -1, 5)


def _upper_triangular(x: Float[Tensor, "batch cells 3"]) -> Float[Tensor, "batch cells 2 2"]:
    """Return a square root of each cell's information from the logarithms of its diagonal and the value off it."""
    x_x, y_y = x[..., :2].clamp(*_LOG_BOUNDS).exp().unbind(dim=-1)
    rows = [torch.stack([x_x, x[..., 2]], dim=-1), torch.stack([torch.zeros_like(y_y), y_y], dim=-1)]
    return torch.stack(rows, dim=-2)
