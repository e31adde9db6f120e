"""Step the gymnasium environment: one step is one attempt to pick a part from the bin."""

import gymnasium


def main(count: int = 6, steps: int = 3) -> None:
    """Fill a bin with bolts and tees, and try a few random picks."""
    env = gymnasium.make("simpick:simpick/BinPick-v0", parts=["hex_bolt", "pipe_tee"], count=count)
    observation, info = env.reset(seed=0)  # The seed is the bin: the same in every process.
    for name, value in observation.items():
        print(f"{name:15} {value.shape} {value.dtype}")
    env.action_space.seed(0)
    for _ in range(steps):
        action = env.action_space.sample()  # TCP position (3), 6D rotation (6), opening (1), each in [-1, 1].
        observation, reward, terminated, _, info = env.step(action)
        print(f"reward {reward:+.1f}, {info['pick'].outcome}: {info['pick'].cause}")
        if terminated:
            break
    env.close()


if __name__ == "__main__":
    main()
