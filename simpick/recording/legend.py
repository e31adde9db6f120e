"""Which colour means what in a recording: detections, estimates and the truth."""

from __future__ import annotations

DETECTION_RGB = (255, 150, 30)
"""Orange: what the detector found."""
ESTIMATE_RGBS = ((0, 220, 255), (255, 90, 220))
"""Cyan, and magenta for a second mode such as the closer look: where the estimator believes the parts to be."""
TRUTH_RGB = (90, 255, 90)
"""Green: where the simulator has them."""

LEGEND_PATH = "/legend"
LEGEND = """

- **orange**: detections, outlines and boxes in the image and outlines in 3D (`world/detections`)
- **cyan**: estimated poses, translucent parts with edges (`world/estimates`); magenta: a closer look
- **green**: true poses when the image was taken (`world/truth`)
- own colours: the simulated parts, arm and bins
- red, green, blue axes: the chosen gripper pose (`world/grasp`)

Perception gets the image alone. The panel on the left has an eye beside each entity, which hides it.
"""
"""The recording's description, in Markdown."""


def estimate_rgb(mode_index: int) -> tuple[int, int, int]:
    """Return the colour of the estimates of a mode, by the order in which modes first estimated."""
    return ESTIMATE_RGBS[min(mode_index, len(ESTIMATE_RGBS) - 1)]
