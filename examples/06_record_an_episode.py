"""Record an episode for the rerun viewer, and read its picks back from the file."""

from pathlib import Path

from simpick import BinPickEnv, Perception, PickPolicy, load_estimator, run_episode
from simpick.estimators import LearnedDetector
from simpick.recording import RerunRecorder, metrics_from_rrd


def main(file: Path = Path("logs/example.rrd"), mode: str = "refined", count: int = 6) -> int:
    """Write the recording and return how many picks it holds."""
    env = BinPickEnv(parts=["hex_bolt", "pipe_tee"], count=count)
    perception = Perception(mode, LearnedDetector(), load_estimator(mode))
    policy = PickPolicy(perception, env.parts, env.scene_config)
    file.parent.mkdir(parents=True, exist_ok=True)
    with RerunRecorder(file, overwrite=True) as recorder:
        result = run_episode(env, policy, seed=0, recorder=recorder)
    env.close()

    picks = metrics_from_rrd(file)
    for pick in picks:
        print(f"pick {pick.pick}: {pick.target_part}, {pick.outcome}, {pick.motion_s:.1f} s")
    assert [pick.outcome for pick in picks] == [pick.outcome for pick in result.picks]
    print(f"look at it with: rerun {file}")
    return len(picks)


if __name__ == "__main__":
    main()
