"""`CadPoseEstimate`: a pose estimate in the frame of the part's CAD file."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.geometry import invert
from simpick.records import PoseEstimate


@dataclass(frozen=True, eq=False, kw_only=True)
class CadPoseEstimate(PoseEstimate):
    """A `PoseEstimate` that knows its part's CAD file.

    `T_camera_part` is the pose of simpick's own part frame, which is centred on the bounding box; `T_camera_cad` is
    that of the file's frame.
    """

    T_cad_part: Float[np.ndarray, "4 4"]
    """Leads from the part frame to the frame of the CAD file, in metres."""
    metres_per_cad_unit: float
    """Unit of the CAD file's coordinates: 0.001 for millimetres."""

    @staticmethod
    def of(estimate: PoseEstimate, part: Part) -> CadPoseEstimate:
        """Return an estimate of this part with what leads to its CAD file."""
        values = {field.name: getattr(estimate, field.name) for field in fields(PoseEstimate)}
        return CadPoseEstimate(**values, T_cad_part=part.T_cad_part, metres_per_cad_unit=part.metres_per_cad_unit)

    @property
    def T_camera_cad(self) -> Float[np.ndarray, "4 4"]:
        """Return the pose of the CAD file's frame in the camera, in metres; camera axes as in OpenCV."""
        return self.T_camera_part @ invert(self.T_cad_part)

    @property
    def T_camera_cad_units(self) -> Float[np.ndarray, "4 4"]:
        """Return the same pose in the CAD file's own unit: maps the file's coordinates to camera coordinates."""
        T = self.T_camera_cad.copy()
        T[:3, 3] /= self.metres_per_cad_unit
        return T
