"""The look through the wrist camera, by the real refiner, moves a retrieved pose nearer to the truth."""

import numpy as np
import pytest
from jaxtyping import Float

from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import make_env, run_configured_episode
from simpick.policies.closer_look import CloserLook
from simpick.records import CameraFrame, PoseEstimate

pytestmark = pytest.mark.render


def test_a_retrieved_pose_is_nearer_to_the_truth_after_the_closer_look(monkeypatch: pytest.MonkeyPatch) -> None:
    config = RunConfig(parts=("l_bracket",), count=1, estimator="retrieval", detections="perfect", look_closer=True)
    env, refined = make_env(config), CloserLook.refined
    distances_mm: list[tuple[float, float]] = []

    def looked(
        look: CloserLook, frame: CameraFrame, part: str, T_world_part: Float[np.ndarray, "4 4"]
    ) -> PoseEstimate | None:
        # As if the first look had been wrong in depth, beyond what the bin's floor corrects.
        T_world_part = T_world_part.copy()
        T_world_part[2, 3] += 0.012
        view = refined(look, frame, part, T_world_part)
        assert view is not None
        T_world_refined = frame.T_world_camera @ view.T_camera_part
        true = env.truth()[0].T_world_part
        before, after = (1e3 * np.linalg.norm(T[:3, 3] - true[:3, 3]) for T in (T_world_part, T_world_refined))
        distances_mm.append((float(before), float(after)))
        return view

    monkeypatch.setattr(CloserLook, "refined", looked)
    result = run_configured_episode(config, 0, env=env)
    env.close()
    before, after = distances_mm[0]
    assert before > 5 and after < 0.5 * before
    assert result.delivered == 1 and result.picks[0].pose_error is not None
    assert result.picks[0].pose_error.translation_mm == pytest.approx(after, abs=1e-6)
