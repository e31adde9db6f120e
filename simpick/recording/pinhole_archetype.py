"""A pinhole camera in rerun."""

from __future__ import annotations

import rerun as rr

from simpick.geometry.pinhole import Pinhole

_FRUSTUM_M = 0.12


def pinhole_archetype(camera: Pinhole) -> rr.Pinhole:
    """Return a camera as rerun draws it: OpenCV axes, a small frustum."""
    return rr.Pinhole(
        image_from_camera=camera.K,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_FRUSTUM_M,
    )
