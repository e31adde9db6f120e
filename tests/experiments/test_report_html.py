"""The report escapes names that users choose, and claims no more than its bins permit."""

from pathlib import Path

from simpick.experiments.comparison import Comparison
from simpick.experiments.config import CompareConfig, RunConfig
from simpick.experiments.report.html import write_report
from simpick.experiments.result_store import EpisodeResult, ResultStore
from tests.experiments.test_result_store import make_pick

MARKUP = "<b>bold</b>"


def report(folder: Path, *modes: str, episodes: int) -> str:
    """Return the report of modes that were compared with the oracle."""
    config = CompareConfig(modes=("oracle", *modes), parts=(MARKUP,), episodes=2)
    store = ResultStore(folder, config.to_json(), config_file="compare.json")
    for episode in range(episodes):
        for name in config.modes:
            store.add(EpisodeResult(episode, episode, ("tee",), (make_pick(0),), "cleared", {}, name))
    runs = {mode: RunConfig(estimator=mode) for mode in config.modes}
    return write_report(Comparison(config, runs, store)).read_text()


def test_names_of_modes_and_parts_are_escaped(tmp_path: Path) -> None:
    html = report(tmp_path, MARKUP, episodes=2)
    assert MARKUP not in html and html.count("&lt;b&gt;bold&lt;/b&gt;") > 5
    assert "With true poses (oracle) the same cell reaches" in html
    assert f"{MARKUP} " not in (tmp_path / "plots" / "success.svg").read_text()


def test_a_comparison_without_a_whole_bin_reports_so(tmp_path: Path) -> None:
    html = report(tmp_path, "retrieval", episodes=0)
    assert "No bin has been finished by every mode yet" in html and "Partial: 2 of 2 bins are left out" in html


def test_one_bin_decides_no_difference(tmp_path: Path) -> None:
    html = report(tmp_path, "retrieval", "fine", episodes=1)
    assert "differs from that of fine cannot be decided from one bin." in html
    assert "1 paired bin of" in html and "One bin has no intervals:" in html and "includes zero" not in html
    assert ">nan" not in html and "(nan" not in html
