"""`RayPoseConfig`: the size of the network, and switches for the paper's ablations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Interval

from simpick.config import Config, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError, UnknownNameError


def encoder_widths(local_width: int) -> tuple[int, int, int]:
    """Return the channels of simpick's own image encoder: of its stem, of its fine features and of its coarse ones."""
    return max(8, local_width // 6), max(16, local_width // 3), local_width


def norm_groups(channels: int) -> int:
    """Return the groups of a group normalisation; they must divide the channels."""
    return min(8, channels // 4)


@dataclass(frozen=True)
class RayPoseConfig(Config):
    """Everything that the network depends on beside its weights; stored in every checkpoint."""

    image_encoder: Literal["simpick", "dinov2_vits14", "dinov2_vitb14", "dinov2_vitl14"] = "simpick"
    """Encoder of crops (E_I of the paper): simpick's own is trained, DINOv2 is frozen and read from a local file."""
    crop_px: PositiveInt = 96
    """Side of the virtual-camera crops that the network sees, in pixels."""
    padding: Annotated[float, Interval(ge=1, le=3)] = 1.2
    """Side of a crop over the longer side of the detection's box."""
    local_cells: PositiveInt = 12
    """Side of the image encoder's feature map, on which query and templates are matched."""
    map_cells: PositiveInt = 6
    """Side p of the pose maps and of the token grid; divides local_cells."""
    local_width: PositiveInt = 96
    """Channels of the image encoder's feature map."""
    match_width: PositiveInt = 64
    """Channels of the descriptors that are matched."""
    width: PositiveInt = 160
    """Channels of the tokens in fuser and decoder."""
    heads: PositiveInt = 5
    """Attention heads of fuser and decoder."""
    fuser_blocks: NonNegativeInt = 1
    """Self-attention blocks over the tokens of all templates (N_F of the paper)."""
    decoder_blocks: NonNegativeInt = 3
    """DiT blocks of the decoder (N_D of the paper)."""
    fourier_bands: NonNegativeInt = 4
    """Frequencies of each Fourier encoding of the view encoder: 1, 2, 4, ... periods over [-1, 1]."""
    templates: PositiveInt = 8
    """Templates that a pose is estimated from."""
    matching: bool = True
    """Give the decoder the template geometry that each query cell's descriptor matches. Not in the paper."""
    flow: bool = True
    """Correct the matched pose by the flow from the nearest templates to the query. Not in the paper."""
    flow_width: PositiveInt = 32
    """Channels of the descriptors of the flow's cells, which are half as wide."""
    flow_radius: PositiveInt = 2
    """Radius, in these cells, in which flow searches for each template cell."""
    relative_pose: bool = True
    """Predict the pose relative to each template, as the paper; off: the absolute pose (ablation 4)."""
    multiview: bool = True
    """Let templates attend to each other and the query to all of them; off: one template each (ablation 5)."""
    template_pose: bool = True
    """Input the templates' poses and geometry; off: only their boxes (ablation 6)."""
    template_views: Literal["random", "fixed"] = "random"
    """Templates that a coarse predictor is trained with: drawn for each query, or always the same."""
    spread_deg: Annotated[float, Interval(gt=0, le=180)] = 30.0
    """Largest angle between a fine predictor's templates and the pose that they are drawn around; coarse: 180."""
    spread_m: Annotated[float, Interval(ge=0, le=0.5)] = 0.05
    """Largest distance of a fine predictor's templates from that pose; it shifts and scales their crops."""

    def _check_rules(self) -> None:
        if self.local_cells % self.map_cells:
            raise ConfigError(
                f"map_cells must divide local_cells, got map_cells={self.map_cells}, local_cells={self.local_cells}"
            )
        patch = 14 if self.is_dino else 8
        if self.crop_px != patch * self.local_cells:
            raise ConfigError(
                f"crop_px must be {patch} times local_cells, the stride of {self.image_encoder!r}, got "
                f"crop_px={self.crop_px}, local_cells={self.local_cells}"
            )
        if self.flow and not (self.matching and self.template_pose):
            raise ConfigError("flow needs matching and template_pose; without them set flow=False too")
        if self.flow and self.is_dino:
            raise ConfigError(
                "flow needs simpick's own image encoder: DINOv2 has no cells half as wide; set flow=False"
            )
        if not self.is_dino and any(
            width < 4 or width % norm_groups(width) for width in encoder_widths(self.local_width)[1:]
        ):
            raise ConfigError(
                f"local_width must be a width that groups divide, as multiples of 24 are, got {self.local_width}"
            )
        if self.width % self.heads:
            raise ConfigError(f"heads must divide width, got heads={self.heads}, width={self.width}")

    @property
    def is_dino(self) -> bool:
        """Return whether the image encoder is a frozen DINOv2."""
        return self.image_encoder != "simpick"

    @property
    def flow_cells(self) -> int:
        """Return the side of the grid that flow is measured on."""
        return 2 * self.local_cells

    @property
    def geometry_cells(self) -> int:
        """Return the side of the grid of crops' geometry: the finest that the network uses."""
        return self.flow_cells if self.flow else self.local_cells

    @property
    def is_fine(self) -> bool:
        """Return whether templates are drawn around a pose, instead of over the whole sphere."""
        return self.spread_deg < 180


PRESETS: dict[str, RayPoseConfig] = {
    "tiny": RayPoseConfig(
        crop_px=48,
        local_cells=6,
        map_cells=3,
        local_width=24,
        match_width=16,
        flow_width=16,
        width=32,
        heads=2,
        decoder_blocks=1,
    ),
    "small": RayPoseConfig(),
    "base": RayPoseConfig(
        crop_px=128,
        local_cells=16,
        map_cells=8,
        local_width=192,
        match_width=96,
        width=384,
        heads=6,
        fuser_blocks=4,
        decoder_blocks=8,
    ),
    "paper": RayPoseConfig(
        image_encoder="dinov2_vitb14",
        crop_px=224,
        local_cells=16,
        map_cells=16,
        local_width=768,
        match_width=128,
        width=768,
        heads=12,
        fuser_blocks=4,
        decoder_blocks=12,
        matching=False,
        flow=False,
    ),
}
"""Sizes by name: ``tiny`` for tests, ``small`` ships, ``base`` needs a GPU, ``paper`` is the published recipe."""


def preset(name: str) -> RayPoseConfig:
    """Return a size by name; raises UnknownNameError."""
    if name not in PRESETS:
        raise UnknownNameError("RayPose size", name, list(PRESETS))
    return PRESETS[name]
