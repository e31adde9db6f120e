"""Empty a bin with the simulator's true poses: the upper bound for every perception mode."""

from simpick import BinPickEnv, Perception, PickPolicy
from simpick.estimators import OracleEstimator, SegmentationDetector


def main(part: str = "crane_hook", count: int = 8) -> int:
    """Pick until the episode ends and return how many parts were delivered."""
    env = BinPickEnv(parts=[part], count=count, gripper="suction")
    detector = SegmentationDetector(instance_parts=env.instance_part_names)
    perception = Perception("oracle", detector, OracleEstimator(env.truth))
    policy = PickPolicy(perception, env.parts, env.scene_config)
    observation, info = env.reset(seed=0)
    delivered, ended = 0, ""
    while not ended:
        action = policy.act(observation)  # Detect, estimate, choose the best grasp that the arm can reach.
        observation, _, _, _, info = env.step(action)
        delivered += len(info["pick"].delivered)
        print(f"{info['pick'].outcome}: {info['pick'].cause}; {info['pick'].remaining} parts left")
        ended = info["ended"]
    print(f"{delivered} of {count} parts delivered ({ended})")
    env.close()
    return delivered


if __name__ == "__main__":
    main()
