"""What goes into the network and what it keeps of templates and queries, so that each is encoded once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from jaxtyping import Float, Int
from torch import Tensor

from simpick.estimators.raypose.network.flow import Flow, FlowCells
from simpick.estimators.raypose.network.layers import KeysValues
from simpick.estimators.raypose.network.matching import Matches
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.estimators.raypose.network.pose_solver import SolvedPoses


@dataclass(frozen=True, eq=False)
class QueryInputs:
    """Crops of detections; all that is known of them."""

    rgb: Float[Tensor, "batch 3 size size"]
    """In [0, 1]."""
    masks: Float[Tensor, "batch size size"]
    half_tangent: Float[Tensor, "batch"]
    """Tangent of half the crop's angle."""


@dataclass(frozen=True, eq=False)
class TemplateInputs:
    """Crops of rendered views with their poses and geometry."""

    rgb: Float[Tensor, "batch views 3 size size"]
    masks: Float[Tensor, "batch views size size"]
    half_tangent: Float[Tensor, "batch views"]
    poses: ViewPoses
    """Leading dimensions (batch, views)."""
    points: Float[Tensor, "batch views cells 3"]
    """Mean position in the part's frame of what each cell shows, in diameters; 0 where it shows nothing. Cells are
    those of `RayPoseConfig.geometry_cells`."""
    coverage: Float[Tensor, "batch views cells"]
    """Share of each cell that the part covers."""
    diameter_m: Float[Tensor, "batch"]


@dataclass(frozen=True, eq=False)
class TemplateTokens:
    """What is kept of templates: made once, for any query."""

    tokens: Float[Tensor, "batch views tokens width"]
    descriptors: Float[Tensor, "batch views cells match_width"]
    points: Float[Tensor, "batch views cells 3"]
    coverage: Float[Tensor, "batch views cells"]
    poses: ViewPoses
    diameter_m: Float[Tensor, "batch"]
    flow: FlowCells
    """Cells half as wide; none if the network measures no flow."""
    kv: Sequence[KeysValues] = ()
    """Once fused: each decoder block's keys and values of the tokens; without multiview, one group a template."""

    def for_queries(self, sets: Int[Tensor, "queries"]) -> TemplateTokens:
        """Return for each query the set of templates that it is compared with."""
        views = self.tokens.shape[1]

        def chosen(x: Tensor) -> Tensor:
            if len(x) == len(self.tokens):
                # One set for all is not copied.
                return x.expand(len(sets), *x.shape[1:]) if len(x) == 1 else x[sets]
            return chosen(x.unflatten(0, (-1, views))).flatten(0, 1)

        kv = [(chosen(k), chosen(v)) for k, v in self.kv]
        tensors = {n: chosen(getattr(self, n)) for n in ("tokens", "descriptors", "points", "coverage", "diameter_m")}
        poses, flow = map_tensors(self.poses, chosen), map_tensors(self.flow, chosen)
        return dataclasses.replace(self, poses=poses, flow=flow, kv=kv, **tensors)


@dataclass(frozen=True, eq=False)
class QueryTokens:
    """What is kept of a query."""

    tokens: Float[Tensor, "batch tokens width"]
    descriptors: Float[Tensor, "batch cells match_width"]
    coverage: Float[Tensor, "batch cells"]
    places: Float[Tensor, "batch cells 2"]
    """Mean place of each cell's pixels of the mask, in half crop sides: matched points are means over them."""
    half_tangent: Float[Tensor, "batch"]
    flow_descriptors: Float[Tensor, "batch flow_cells flow_width"]
    """Of cells half as wide; none if the network measures no flow."""
    flow_coverage: Float[Tensor, "batch flow_cells"]


@dataclass(frozen=True, eq=False)
class InitialPoses:
    """What matches, and then flow, say of the pose: what the decoder corrects."""

    matches: Matches
    solved: SolvedPoses
    """From matches, from each view's own pose."""
    flow: Flow | None
    """From there; None if the network measures none."""
    poses: SolvedPoses
    """The last answer, for each view."""


@dataclass(frozen=True, eq=False)
class Conditioning:
    """All that the decoder needs beside noisy maps: the same at every step."""

    base: Float[Tensor, "groups views tokens width"]
    """Without multiview, every template is a group of its own."""
    kv: Sequence[KeysValues]
    reference: ViewPoses
    """What poses are relative to; leading dimensions (batch, views)."""
    first: Float[Tensor, "groups views tokens 6"]
    """Maps that the decoder corrects: those of the first poses, or of "same pose as the reference"."""
    matched: InitialPoses | None


Record = TypeVar("Record", FlowCells, QueryTokens, SolvedPoses, ViewPoses)


def map_tensors(record: Record, function: Callable[[Tensor], Tensor]) -> Record:
    """Return a record of tensors with the function applied to each."""
    return type(record)(*(function(getattr(record, field.name)) for field in dataclasses.fields(record)))
