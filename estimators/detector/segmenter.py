"""`InstanceSegmenter`: the instances in an image, with or without knowledge of the parts that may be in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.errors import ConfigError
from simpick.estimators.detector.decoding import DecodingConfig, full_mask, label_nodes
from simpick.estimators.detector.encoder_stages import STRIDE
from simpick.estimators.detector.merge_tree import MergeTree, merge_tree
from simpick.estimators.detector.network import InstanceNetwork
from simpick.estimators.detector.outlines import sharpen_outlines
from simpick.estimators.detector.scores import MaskScore, is_one_instance

WORKING_PX = 960
"""Longer side of the image that the network sees; smaller images are enlarged. It was trained at this scale."""
SMALLEST_PX = 32
"""Least width and height of an image."""
# The network's cells of an enlarged image are finer than two of its pixels.
_BAND_PX = 1
# Pieces with fewer cells have no shape that templates could judge.
_JUDGED_CELLS = 40

Judge = Callable[[Sequence[Bool[np.ndarray, "height width"]]], Float[np.ndarray, "masks"]]
"""Returns how similar each mask's content is to a part, in [0, 1]."""


@dataclass(frozen=True, eq=False)
class SegmentedImage:
    """Instances of one image, best score first."""

    masks: list[Bool[np.ndarray, "height width"]]
    """Visible pixels; no two overlap."""
    scores: Float[np.ndarray, "instances"]
    """Probability that the mask overlaps an instance by an IoU of at least one half."""
    features: Float[np.ndarray, "instances 4"]
    """What the scores follow from; see `Instances`."""
    foreground: Bool[np.ndarray, "height width"]
    """Pixels that show parts, also those that belong to no instance."""


def _nothing(height: int, width: int) -> SegmentedImage:
    return SegmentedImage([], np.zeros(0), np.zeros((0, 4)), np.zeros((height, width), bool))


class InstanceSegmenter:
    """Runs the network and reads the instances from its maps."""

    def __init__(
        self, network: InstanceNetwork, score: MaskScore | None = None, config: DecodingConfig | None = None
    ) -> None:
        self.network = network.eval().to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.score = score or MaskScore()
        self.config = config or DecodingConfig()

    def segment(self, rgb: UInt8[np.ndarray, "height width 3"], judge: Judge | None = None) -> SegmentedImage:
        """Return the instances of an image of any size; `judge` decides where the network is unsure.

        Raises:
            ConfigError: the image is not of 8-bit RGB, or smaller than 32 px.
        """
        height, width = checked_size(rgb)
        # An image of one colour shows nothing, and the network was never trained on one.
        if not (rgb != rgb[0, 0]).any():
            return _nothing(height, width)
        scale = WORKING_PX / max(height, width)
        image = _resized(rgb, scale)
        # What the network sees enlarged has no more detail than the image itself.
        shown = rgb if scale > 1 else image
        rows, columns = shown.shape[:2]
        cell_scale = (rows / image.shape[0], columns / image.shape[1])

        def shown_mask(cells: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "rows columns"]:
            return full_mask(cells, rows, columns, scale=cell_scale)

        def fit_size(mask: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "height width"]:
            if mask.shape == (height, width):
                return mask
            return cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5

        foreground, affinities = self.maps(image)
        is_part = foreground > self.config.foreground
        if not is_part.any():
            return _nothing(height, width)
        tree = merge_tree(is_part, affinities, certain=self.config.certain, possible=self.config.possible)
        accept = self._acceptance(tree, lambda cells: fit_size(shown_mask(cells)), judge)
        instances = label_nodes(tree, tree.cut(accept), foreground, self.config.min_cells)
        masks = [shown_mask(instances.labels == k) for k in range(1, len(instances.features) + 1)]
        masks = [fit_size(mask) for mask in sharpen_outlines(shown, masks, band_px=_BAND_PX)]
        scores = self.score(instances.features)
        order = [int(k) for k in np.argsort(-scores, kind="stable") if masks[k].any()]
        return SegmentedImage(
            [masks[k] for k in order], scores[order], instances.features[order], fit_size(shown_mask(is_part))
        )

    def _acceptance(
        self, tree: MergeTree, mask_of: Callable[[np.ndarray], np.ndarray], judge: Judge | None
    ) -> Callable[[int], bool]:
        """Return which nodes that may be divided are taken as one instance."""
        similarity: dict[int, float] = {}
        if judge is not None:
            doubtful = [
                k
                for k, node in enumerate(tree.nodes)
                if node.children and all(tree.nodes[child].cells >= _JUDGED_CELLS for child in node.children)
            ]
            judged = sorted({*doubtful, *(child for k in doubtful for child in tree.nodes[k].children or ())})
            values = judge([mask_of(tree.mask(k)) for k in judged])
            similarity = dict(zip(judged, values.tolist(), strict=True))

        def accept(k: int) -> bool:
            node = tree.nodes[k]
            if node.children is None or not all(child in similarity for child in node.children):
                return node.affinity > self.config.merge
            a, b = node.children
            share = tree.nodes[a].cells / node.cells
            gain = similarity[k] - share * similarity[a] - (1 - share) * similarity[b]
            return is_one_instance(node.affinity, gain)

        return accept

    def maps(
        self, rgb: UInt8[np.ndarray, "height width 3"]
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "offsets h w"]]:
        """Return the probabilities of foreground and of the affinities, for cells that cover the image."""
        height, width = rgb.shape[:2]
        bottom, right = -height % STRIDE, -width % STRIDE
        padded = cv2.copyMakeBorder(rgb, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
        device = next(self.network.parameters()).device
        # Channels last, as the image is. Bytes, and what the network makes of them first, are exact in bfloat16.
        x = torch.from_numpy(padded).to(device).permute(2, 0, 1)[None].to(torch.bfloat16)
        with torch.inference_mode(), torch.autocast(device.type, torch.bfloat16):
            maps = self.network(x)
        rows, columns = -(-height // 2), -(-width // 2)
        foreground = maps.foreground[0, :rows, :columns].float().sigmoid()
        affinities = maps.affinities[0, :, :rows, :columns].float().sigmoid()
        return foreground.cpu().numpy(), affinities.cpu().numpy()


def _resized(rgb: UInt8[np.ndarray, "height width 3"], scale: float) -> UInt8[np.ndarray, "rows columns 3"]:
    """Return the image at the size that the network sees."""
    height, width = rgb.shape[:2]
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    if size == (width, height):
        return rgb
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)


def checked_size(rgb: np.ndarray) -> tuple[int, int]:
    """Return the height and width of an image.

    Raises:
        ConfigError: it is not of 8-bit RGB, or too small.
    """
    if rgb.dtype != np.uint8:
        raise ConfigError(f"an image must have 8-bit channels (uint8), got {rgb.dtype}")
    if rgb.ndim != 3 or rgb.shape[2] != 3:
        raise ConfigError(
            f"an image must have three channels (height, width, 3), got shape {rgb.shape}; "
            "repeat a grey image's channel three times"
        )
    height, width = rgb.shape[:2]
    if min(height, width) < SMALLEST_PX:
        raise ConfigError(f"an image must be at least {SMALLEST_PX} px wide and high, got {width} x {height}")
    return height, width
