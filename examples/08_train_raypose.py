"""Train a tiny RayPose network for two minutes on random parts, and load its weights as an estimator."""

from pathlib import Path
from typing import Any

from simpick.estimators.raypose import PRESETS, RayPoseEstimator, load_raypose
from simpick.training import Budget, TrainConfig, train

CONFIG = TrainConfig(batch=16, min_ready_shards=4, validation_shards=2)
BUDGET = Budget(minutes=2)


def show(row: dict[str, Any], progress: float) -> None:
    """Print a row of the log: the loss in training, errors of sampled poses in validation."""
    figures = {name: round(row[name], 2) for name in ("loss", "rotation_deg", "depth_percent") if name in row}
    print(f"{progress:4.0%}, {row['queries']} queries: {figures}")


def main(
    folder: Path = Path("logs/example_train"), config: TrainConfig = CONFIG, budget: Budget = BUDGET
) -> RayPoseEstimator:
    """Train and return the estimator. Two minutes are far too few: the shipped weights took 3.8 hours."""
    weights = train(PRESETS["tiny"], config, budget, folder, on_row=show)
    print(f"weights: {weights}")
    return load_raypose("fine", weights=weights)


if __name__ == "__main__":
    main()
