"""Modes and the runs that they stand for."""

import pytest

from simpick.errors import ConfigError
from simpick.experiments.config import CompareConfig, RunConfig, SweepConfig
from simpick.experiments.modes import Mode, parse_mode


@pytest.mark.parametrize(
    ("text", "mode"),
    [
        ("retrieval", Mode("retrieval")),
        ("refined@8+closer", Mode("refined", 8, look_closer=True)),
        ("oracle_noise", Mode("oracle_noise")),
        ("oracle_noise@2.5deg", Mode("oracle_noise", noise=(2.5, "deg"))),
        ("oracle_noise@10mm+closer", Mode("oracle_noise", noise=(10.0, "mm"), look_closer=True)),
    ],
)
def test_a_mode_is_written_as_it_is_read(text: str, mode: Mode) -> None:
    assert parse_mode(text) == mode and str(mode) == text


@pytest.mark.parametrize("text", ["oracle_noise@8", "oracle_noise@0mm", "oracle_noise@2cm", "oracle_noise@-1deg"])
def test_noise_needs_a_level_and_a_unit(text: str) -> None:
    with pytest.raises(ConfigError, match=rf"above 0 in mm or deg, such as oracle_noise@2\.5deg; got '{text}'"):
        parse_mode(text)


def test_each_mode_stands_for_a_run_of_the_same_cell() -> None:
    modes = ("oracle", "oracle_noise", "oracle_noise@2mm", "oracle_noise@3deg+closer", "retrieval@4")
    runs = CompareConfig(modes=modes, count=3, noise_deg=1.0, noise_mm=7.0).runs()
    assert tuple(runs) == modes and {run.count for run in runs.values()} == {3}
    noise = {mode: (run.noise_deg, run.noise_mm) for mode, run in runs.items()}
    assert noise["oracle_noise"] == (1, 7) and noise["oracle_noise@2mm"] == (0, 2)
    assert noise["oracle_noise@3deg+closer"] == (3, 0) and noise["retrieval@4"] == (0, 0)
    assert runs["oracle_noise@3deg+closer"].look_closer and runs["retrieval@4"].hypotheses == 4


def test_a_run_is_named_by_its_mode() -> None:
    assert RunConfig(estimator="fine", hypotheses=8, look_closer=True).mode == "fine@8+closer"
    assert RunConfig(estimator="oracle", noise_mm=2).mode == "oracle_noise@2mm"
    assert RunConfig(estimator="oracle", noise_mm=2, noise_deg=1).mode == "oracle_noise"


def test_what_nobody_asked_otherwise_is_found_in_the_image() -> None:
    assert (RunConfig().estimator, RunConfig().detections) == ("refined", "learned")
    assert CompareConfig().detections == "learned" and "refined" in CompareConfig().modes
    runs = CompareConfig(modes=("oracle", "refined", "oracle_noise@2mm")).runs()
    assert [run.detections_used for run in runs.values()] == ["perfect", "learned", "perfect"]
    realistic = CompareConfig(modes=("oracle", "refined"), detections="realistic").runs()
    assert {run.detections_used for run in realistic.values()} == {"realistic"}


def test_a_sweep_compares_its_levels_and_runs_true_poses_once() -> None:
    sweep = SweepConfig(levels_mm=(0.0, 2.0), levels_deg=(0.0, 2.5), seed=4)
    assert sweep.steps() == [
        ("mm", 0.0, "oracle"),
        ("mm", 2.0, "oracle_noise@2mm"),
        ("deg", 0.0, "oracle"),
        ("deg", 2.5, "oracle_noise@2.5deg"),
    ]
    comparison = sweep.comparison()
    assert comparison.modes == ("oracle", "oracle_noise@2mm", "oracle_noise@2.5deg")
    assert (comparison.seed, comparison.episodes) == (4, 4)
