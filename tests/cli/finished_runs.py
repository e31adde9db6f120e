"""Reading the results of commands."""

from pathlib import Path

from simpick.experiments.result_store import read_results


def timeless(folder: Path) -> list[dict]:
    """Return the episodes in a folder without their timings, which differ from run to run."""
    return [result.to_json(timings=False) for result in read_results(folder / "results.jsonl")]
