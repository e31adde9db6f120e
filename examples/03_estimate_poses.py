"""Estimate the 6D poses of all parts in one RGB image, and measure the errors against the truth."""

import numpy as np

from simpick import BinPickEnv, load_estimator
from simpick.envs import frame_from_observation
from simpick.estimators import LearnedDetector
from simpick.geometry import invert
from simpick.metrics import EvaluationModel, mssd, pose_error


def main(mode: str = "refined", part: str = "pipe_tee", count: int = 6) -> float:
    """Print each detection's estimate and return the median rotation error in degrees."""
    env = BinPickEnv(parts=[part], count=count)
    observation, _ = env.reset(seed=0)
    frame = frame_from_observation(observation)  # RGB image with its camera.
    detections = LearnedDetector().detect(frame, env.parts)  # Parts that the network has never seen.

    estimator = load_estimator(mode)  # Such as retrieval, fine, refined; "refined@5" asks for five hypotheses.
    for known in env.parts:
        estimator.onboard(known)  # Renders templates once; they are cached.
    estimates = estimator.estimate(frame, detections)

    model = EvaluationModel.of(env.parts[0])
    Ts_true = invert(frame.T_world_camera) @ np.stack([instance.T_world_part for instance in env.truth()])
    errors = []
    for estimate in estimates:
        nearest = Ts_true[mssd(estimate.T_camera_part, Ts_true, model).argmin()]
        error = pose_error(estimate.T_camera_part, nearest, model)  # The part's symmetries count as correct.
        errors.append(error.rotation_deg)
        x, y, z = 1000 * estimate.T_camera_part[:3, 3]
        print(
            f"{estimate.part} at ({x:.0f}, {y:.0f}, {z:.0f}) mm in the camera, score {estimate.score:.2f}: "
            f"error {error.rotation_deg:.1f} deg, {error.translation_mm:.1f} mm"
        )
    env.close()
    return float(np.median(errors))


if __name__ == "__main__":
    main()
