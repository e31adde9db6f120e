"""Compare two perception modes on the same bins, with 95 % intervals."""

from pathlib import Path

from simpick import compare
from simpick.experiments import CompareConfig


def main(folder: Path = Path("logs/example_compare"), episodes: int = 3, count: int = 6) -> list[str]:
    """Let true poses and retrieval pick the same bins; a second call resumes where the first was stopped."""
    config = CompareConfig(modes=("oracle", "retrieval"), parts=("hex_bolt",), episodes=episodes, count=count)
    print(f"detections: {config.detections}")  # What retrieval works from; the oracle is an upper bound.
    statistics = compare(config, folder).statistics()
    for mode in statistics.modes:
        for key in ("grasp_success", "clearance"):
            interval = statistics.measures[mode][key]
            print(f"{mode:10} {key:14} {interval.value:5.1f} % ({interval.low:.1f} to {interval.high:.1f})")
    for difference in statistics.differences:
        interval = difference.measures["grasp_success"]
        print(f"{difference.mode} minus {difference.against}: {interval.value:+.1f} points of grasp success")
    return list(statistics.modes)


if __name__ == "__main__":
    main()
