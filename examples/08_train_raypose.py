"""Train a tiny RayPose network for a minute on random parts, and load its weights as an estimator."""

from pathlib import Path

from simpick.estimators.raypose import PRESETS, RayPoseEstimator, load_raypose
from simpick.training import Budget, TrainConfig, train

CONFIG = TrainConfig(batch=16, validation_shards=2)
BUDGET = Budget(minutes=1)


def main(
    folder: Path = Path("logs/example_train"), config: TrainConfig = CONFIG, budget: Budget = BUDGET
) -> RayPoseEstimator:
    """Train and return the estimator. A minute is far too little: the shipped weights took 3.8 hours."""
    network = PRESETS["tiny"]
    weights = train(network, config, budget, folder, on_row=lambda row, progress: print(f"{progress:4.0%}", row))
    print(f"weights: {weights}")
    return load_raypose("fine", weights=weights)


if __name__ == "__main__":
    main()
