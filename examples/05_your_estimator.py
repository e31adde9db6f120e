"""Write a pose estimator of your own and let it pick: it assumes that parts lie on the floor of the bin."""

from collections.abc import Sequence

import numpy as np

from simpick import BinPickEnv, Perception, PickPolicy, run_episode
from simpick.assets import Part
from simpick.estimators import SegmentationDetector
from simpick.records import CameraFrame, Detection, PoseEstimate


class LyingPartEstimator:
    """Aligns the part's longest axis with the mask, and puts the part on the floor of the bin (z = 0)."""

    def __init__(self) -> None:
        self._parts: dict[str, Part] = {}

    def onboard(self, part: Part) -> None:
        """Remember the part; a learned estimator would render templates here."""
        self._parts[part.name] = part

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate for each detection that has a mask."""
        return [self._estimate(frame, d, np.argwhere(d.mask)) for d in detections if d.mask is not None]

    def _estimate(self, frame: CameraFrame, detection: Detection, mask_px: np.ndarray) -> PoseEstimate:
        extents_m = np.asarray(self._parts[detection.part].mesh.extents)
        order = np.argsort(-extents_m)  # Axes of the part's box, longest first.
        pixels = mask_px[:, ::-1] + 0.5  # Column and row; pixel centres are at integer + 0.5.
        _, directions = np.linalg.eigh(np.cov(pixels.T))
        along = np.append(directions[:, 1], 0.0)  # Longest direction in the image; the camera looks down along +z.
        across = np.cross([0.0, 0.0, 1.0], along)
        R = np.empty((3, 3))
        R[:, order[0]], R[:, order[1]], R[:, order[2]] = along, across, np.cross(along, across)
        R[:, order[2]] *= np.linalg.det(R)
        ray = frame.camera.back_project(pixels.mean(axis=0), np.array(1.0))  # In the camera's frame, at depth 1 m.
        T = frame.T_world_camera
        depth_m = (extents_m[order[2]] / 2 - T[2, 3]) / (T[:3, :3] @ ray)[2]
        T_camera_part = np.eye(4)
        T_camera_part[:3, :3], T_camera_part[:3, 3] = R, depth_m * ray
        return PoseEstimate(detection.part, T_camera_part, 0.5, "lying", 0.0, detection=detection)


def main(count: int = 6) -> float:
    """Pick one bin of bolts and return the share of its parts that were delivered."""
    env = BinPickEnv(parts=["hex_bolt"], count=count)
    # The simulator's masks, an upper bound; `simpick.estimators.LearnedDetector()` finds parts in the image.
    perception = Perception("lying", SegmentationDetector(instance_parts=env.instance_part_names), LyingPartEstimator())
    result = run_episode(env, PickPolicy(perception, env.parts, env.scene_config), seed=0)
    for pick in result.picks:
        print(f"{pick.outcome}: {pick.cause}; {pick.pose_error}")
    return result.delivered / count


if __name__ == "__main__":
    print(f"{main():.0%} of the parts were delivered")
