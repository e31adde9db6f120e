"""`ComparedInstances`: the instances of one image, and how each compares with each part that is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class ComparedInstances:
    """What is decided on for all instances of an image together."""

    masks: list[Bool[np.ndarray, "height width"]]
    scores: Float[np.ndarray, "instances"]
    """Probability that the mask is right."""
    exposure: Float[np.ndarray, "instances"]
    """Share of the mask's surroundings that no other mask covers."""
    similarity: Float[np.ndarray, "instances parts"]
    """Of descriptors; lower where the distance is known."""
    views: Float[np.ndarray, "instances parts"]
    """Logarithm of the odds of the part's views, as the pose network judges them."""
    colours: Float[np.ndarray, "instances parts"]
    """Agreement with the colours of the CAD, which only compares parts with one another."""
    is_distance_known: bool
    """Whether the distance follows from the camera's pose."""
