"""What is drawn over photographs."""

from __future__ import annotations

import numpy as np

from simpick.geometry import Pinhole, transform
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.photos.overlay import _draw_label


def test_the_outline_of_a_label_lies_around_its_letters() -> None:
    image = np.full((120, 400, 3), 128, np.uint8)
    at = transform(None, np.array([0.0, 0.0, 0.5]))
    estimate = CadPoseEstimate(
        "a_part_with_a_long_name", at, 0.87, "fine", 0.1, T_cad_part=np.eye(4), metres_per_cad_unit=1e-3
    )
    _draw_label(image, Pinhole(400, 120, 300.0, 300.0, 60.0, 60.0), estimate, (0, 255, 0), 1)
    black = np.argwhere(image.max(axis=2) < 40)
    green = np.argwhere(image[..., 1] - image[..., 0].astype(int) > 60)
    np.testing.assert_allclose(black.min(axis=0), green.min(axis=0), atol=2)
    np.testing.assert_allclose(black.max(axis=0), green.max(axis=0), atol=2)
