"""Inputs of the network, and what it keeps of templates and queries, so that each is encoded once."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor

from simpick.estimators.raypose.network.flow import FlowCells
from simpick.estimators.raypose.network.layers import KeysValues
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class QueryInputs(TensorRecord):
    """Crops of detections: all that is known of them."""

    rgb: Float[Tensor, "batch 3 size size"]
    """In [0, 1]."""
    masks: Float[Tensor, "batch size size"]
    half_tangent: Float[Tensor, "batch"]
    """Tangent of half the crop's angle."""


@dataclass(frozen=True, eq=False)
class TemplateInputs(TensorRecord):
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
class TemplateTokens(TensorRecord):
    """What is kept of templates: computed once, for any query."""

    tokens: Float[Tensor, "batch views tokens width"]
    descriptors: Float[Tensor, "batch views cells match_width"]
    points: Float[Tensor, "batch views cells 3"]
    coverage: Float[Tensor, "batch views cells"]
    poses: ViewPoses
    diameter_m: Float[Tensor, "batch views"]
    flow: FlowCells
    """The fine level; without cells if the network measures no flow."""
    embedding: Float[Tensor, "batch views embedding"]
    """See `ViewEmbedding`."""
    keys_values: tuple[KeysValues, ...] = ()
    """Of each decoder block, once fused: (batch, groups, heads, tokens, width / heads). All views are one group, or
    without multiview each view is its own."""

    def for_queries(self, sets: Int[Tensor, "queries"]) -> TemplateTokens:
        """Return for each query the set of templates that it is compared with."""
        # A single set is expanded instead of copied.
        return self.map(lambda x: x.expand(len(sets), *x.shape[1:]) if len(x) == 1 else x[sets])


@dataclass(frozen=True, eq=False)
class QueryTokens(TensorRecord):
    """What is kept of a query."""

    tokens: Float[Tensor, "batch tokens width"]
    descriptors: Float[Tensor, "batch cells match_width"]
    coverage: Float[Tensor, "batch cells"]
    """Estimated share of each cell that shows the part; without a fine level that of the mask."""
    pixel_centroids: Float[Tensor, "batch cells 2"]
    """Centroid of each cell's masked pixels, in half crop sides: matched points are means over these pixels."""
    half_tangent: Float[Tensor, "batch"]
    flow_descriptors: Float[Tensor, "batch flow_cells flow_width"]
    """On the fine level; without cells if the network measures no flow."""
    visible: Float[Tensor, "batch fine_cells"]
    """Estimated share of each cell of the fine level that shows the part; no cells if the encoder has no such level."""
    embedding: Float[Tensor, "batch embedding"]
    """See `ViewEmbedding`."""
