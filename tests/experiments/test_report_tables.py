"""Tables of any number of modes can be read in 80 columns."""

import io
from dataclasses import replace

import numpy as np
import pytest

from simpick.experiments.analysis.failure_causes import find_failures
from simpick.experiments.analysis.grasp_scores import score_grasps
from simpick.experiments.analysis.paired import MEASURES, compare_modes
from simpick.experiments.config import RunConfig
from simpick.experiments.report.tables import (
    causes_table,
    differences_tables,
    modes_tables,
    no_attempts_lines,
    one_bin_table,
    scores_table,
    source_line,
)
from simpick.experiments.result_store import EpisodeResult
from simpick.experiments.sweep import NoiseStep, steps_table
from simpick.records import PickOutcome
from simpick.terminal import Console
from tests.experiments.test_result_store import make_pick

MODES = ("oracle", "oracle_noise", "retrieval", "retrieval_refined", "coarse", "fine", "refined", "refined@8")


def test_eight_modes_are_shown_whole_in_80_columns() -> None:
    results = [EpisodeResult(k, k, ("tee",), (make_pick(0),), "cleared", {}, mode) for k in (0, 1) for mode in MODES]
    statistics = compare_modes(results, MODES, np.random.default_rng(0))
    output = io.StringIO()
    console = Console(file=output, width=80)
    tables = modes_tables(statistics)
    for table in (*tables, *differences_tables(statistics)):
        console.print(table)
    text = output.getvalue()
    assert "\u2026" not in text, "nothing is cut off"
    assert text.count("100.0\n") or "100.0" in text
    headings = [str(column.header) for table in tables for column in table.columns[1:]]
    assert [h.split(",")[0] for h in headings] == [m.title for m in MEASURES]
    assert "- retrieval_refined" in text and "(100.0 to 100.0)" in text


def test_causes_of_nine_modes_are_shown_whole_in_80_columns() -> None:
    longest = "retrieval_refined@50+closer"
    outcomes = (PickOutcome.NOTHING_DETECTED, PickOutcome.MISSED, PickOutcome.MISSED, PickOutcome.DROPPED)
    picks = tuple(make_pick(k, outcome) for k, outcome in enumerate(outcomes))
    failures = {mode: [] for mode in MODES}
    failures[longest] = find_failures([EpisodeResult(0, 0, ("tee",), picks, "gave up", {}, longest)])
    output = io.StringIO()
    Console(file=output, width=80).print(causes_table(failures))
    lines = [line.split() for line in output.getvalue().splitlines()]
    assert ["symmetry"] in lines and ["mode", "detection", "pose", "flip", "grasp", "motion", "physics", "all"] in lines
    assert [line for line in lines if line and line[0] in failures] == [
        *([mode, *"0000000"] for mode in MODES),
        [longest, "1", "0", "0", "2", "0", "1", "4"],
    ]


def test_a_mode_without_attempts_says_why_instead_of_nan() -> None:
    cause = "look: the detector found no part, though 812 px show parts"
    blind = tuple(replace(make_pick(k, PickOutcome.NOTHING_DETECTED, None), cause=cause) for k in (0, 1))
    filtered = (replace(make_pick(2, PickOutcome.NO_GRASP, None), cause="plan: no grasp is left"),)
    fault = (make_pick(0, PickOutcome.SIMULATION_FAULT),)
    lines = no_attempts_lines(
        {
            "oracle": [EpisodeResult(0, 0, ("tee",), (make_pick(0),), "cleared", {}, "oracle")],
            "fine": [EpisodeResult(0, 0, ("tee",), blind + filtered, "consecutive_failures", {}, "fine")],
            "coarse": [EpisodeResult(0, 0, ("tee",), fault, "simulation_fault", {}, "coarse")],
            "refined": [],
        }
    )
    assert lines == [
        f"fine: no grasp was attempted in 3 picks; 2 times: {cause}",
        "coarse: no grasp was attempted: the physics diverged in every bin (1)",
        "refined: no grasp was attempted: no bin is finished",
    ]


@pytest.mark.parametrize("outcome", [PickOutcome.NO_GRASP, PickOutcome.SIMULATION_FAULT])
def test_no_table_shows_nan(outcome: PickOutcome) -> None:
    ended = "simulation_fault" if outcome is PickOutcome.SIMULATION_FAULT else "consecutive_failures"
    result = EpisodeResult(0, 0, ("tee",), (make_pick(0, outcome, None),), ended, {}, "oracle")
    statistics = compare_modes([result], ("oracle",), np.random.default_rng(0))
    steps = [NoiseStep("mm", 2.0, score_grasps([result])), NoiseStep("mm", 3.0, score_grasps([]))]
    output = io.StringIO()
    console = Console(file=output, width=80)
    for table in (
        scores_table(RunConfig(), [result]),
        scores_table(RunConfig(), []),
        one_bin_table(statistics),
        *modes_tables(statistics),
        steps_table(steps),
    ):
        console.print(table)
    assert "nan" not in output.getvalue() and "grasp success" in output.getvalue()


def test_one_bin_of_a_sweep_has_no_interval() -> None:
    def rows(bins: int) -> str:
        results = [EpisodeResult(k, k, ("tee",), (make_pick(0),), "cleared", {}, "oracle") for k in range(bins)]
        output = io.StringIO()
        Console(file=output, width=80).print(steps_table([NoiseStep("mm", 2.0, score_grasps(results))]))
        return output.getvalue()

    assert " to " not in rows(1) and " to 100.0%" in rows(2)


def test_one_mode_has_no_differences() -> None:
    result = EpisodeResult(0, 0, ("tee",), (make_pick(0),), "cleared", {}, "oracle")
    assert differences_tables(compare_modes([result], ("oracle",), np.random.default_rng(0))) == []


def test_one_bin_is_one_table_in_80_columns() -> None:
    results = [EpisodeResult(0, 0, ("tee",), (make_pick(0),), "cleared", {}, mode) for mode in MODES]
    output = io.StringIO()
    table = one_bin_table(compare_modes(results, MODES, np.random.default_rng(0)))
    Console(file=output, width=80).print(table)
    lines = [line.split() for line in output.getvalue().splitlines()]
    assert "one bin: no intervals; --episodes N takes more" in output.getvalue()
    assert [line[:3] for line in lines if line and line[0] in MODES] == [[mode, "100.0", "100.0"] for mode in MODES]
    assert "\u2026" not in output.getvalue() and " to " not in output.getvalue()


@pytest.mark.parametrize(
    ("detections", "modes", "line"),
    [
        ("learned", ("fine", "refined"), "learned detections"),
        (
            "learned",
            ("oracle", "refined"),
            "learned detections; oracle modes have the true poses of perfect detections, an upper bound",
        ),
        ("perfect", ("refined",), "perfect detections (simulated, an upper bound)"),
        (
            "realistic",
            ("oracle_noise@2mm",),
            "realistic detections (simulated); oracle modes have the true poses, an upper bound",
        ),
    ],
)
def test_what_rests_on_the_truth_is_named(detections: str, modes: tuple[str, ...], line: str) -> None:
    assert source_line(detections, modes) == line
