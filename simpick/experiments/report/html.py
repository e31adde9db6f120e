"""A comparison as one HTML file that needs nothing else: the answer first, then figures, plots and recordings."""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from simpick.core_time import disturbance_lines
from simpick.experiments.analysis.error_tolerance import success_by_pose
from simpick.experiments.analysis.failure_causes import count_causes
from simpick.experiments.analysis.grasp_scores import PERCEPTION_STAGES
from simpick.experiments.analysis.paired import MEASURES, PairedStatistics, best_mode, executed
from simpick.experiments.comparison import Comparison
from simpick.experiments.modes import parse_mode
from simpick.experiments.report.plots import PLOTS, mode_colours
from simpick.experiments.report.tables import DIFFERENCES, cause_cells, cause_headings, heading, number, source_line
from simpick.experiments.result_store import EpisodeResult

REPORT_FILE = "report.html"
FEW_BINS = 20
"""With fewer bins the report warns of intervals that are too narrow."""


def write_report(comparison: Comparison) -> Path:
    """Write ``report.html`` and ``plots/*.svg`` into the comparison's folder and return the report's path.

    Raises:
        OutputError: the disk is full or gone; results are not touched.
    """
    plots = {name: draw(comparison) for name, draw in PLOTS.items()}
    for name, svg in plots.items():
        comparison.store.write(f"plots/{name}.svg", svg)
    return comparison.store.write(REPORT_FILE, report_html(comparison, plots))


def report_html(comparison: Comparison, plots: dict[str, str]) -> str:
    """Return the report as HTML; `plots` are SVG by name."""
    environment = Environment(
        loader=PackageLoader("simpick.experiments.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "heading": heading}
    environment.tests["known"] = lambda interval: interval.is_known
    paired, failures = comparison.paired(), comparison.failures()
    return environment.get_template("report_template.html").render(
        config=comparison.config,
        source=source_line(comparison.config.detections, comparison.modes),
        disturbances=disturbance_lines(comparison.core_times()),
        modes=comparison.modes,
        colours=mode_colours(comparison.modes),
        # Only what matplotlib drew is not escaped; it escapes texts itself.
        plots={name: Markup(svg[svg.index("<svg") :]) for name, svg in plots.items()},
        measures={measure.key: measure for measure in MEASURES},
        difference_keys=DIFFERENCES,
        stages=PERCEPTION_STAGES,
        stage_times_ms={mode: _stage_times_ms(results) for mode, results in paired.items()},
        shares={mode: success_by_pose([p for r in results for p in executed(r)]) for mode, results in paired.items()},
        failures=failures,
        cause_headings=cause_headings(),
        cause_cells={mode: cause_cells(of_mode) for mode, of_mode in failures.items()},
        few_bins=FEW_BINS,
        provenance=json.dumps(comparison.store.provenance, indent=2),
        versions=", ".join(f"{name} {version(name)}" for name in ("simpick", "mujoco", "torch", "numpy")),
        machine=f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        **_answer(comparison, comparison.statistics()),
        **_recordings(comparison),
    )


def _answer(comparison: Comparison, statistics: PairedStatistics) -> dict[str, Any]:
    """Return what the report's first sentences state."""
    image_based = [mode for mode in comparison.modes if not parse_mode(mode).knows_truth]
    candidates = image_based or list(comparison.modes)
    best = best_mode(statistics, candidates)
    others = [
        ({difference.mode, difference.against} - {best}, difference.measures["grasp_success"])
        for difference in statistics.differences
        if best in (difference.mode, difference.against)
    ]
    causes = count_causes(comparison.failures()[best])
    return {
        "statistics": statistics,
        "image_based": image_based,
        "candidates": candidates,
        "best": best,
        "not_different": [
            (other, interval)
            for pair, interval in others
            for other in pair & set(image_based)
            if not interval.excludes_zero
        ],
        "most_frequent_cause": max(causes, key=causes.__getitem__),
        "most_frequent_count": max(causes.values()),
        "zero_width": [
            f"{measure.title} of {mode}"
            for mode, intervals in statistics.measures.items()
            for measure in MEASURES
            if intervals[measure.key].has_zero_width
        ],
    }


def _stage_times_ms(results: Sequence[EpisodeResult]) -> list[float]:
    """Return the mean time of each stage of perception per pick."""
    picks = [pick for result in results for pick in result.picks]
    return [1e3 * sum(p.timings_s.get(stage, 0.0) for p in picks) / max(len(picks), 1) for stage in PERCEPTION_STAGES]


def _recordings(comparison: Comparison) -> dict[str, Any]:
    """Return results and names of recordings, both by bin and mode, and the commands that open the recordings."""
    results = {result.key: result for result in comparison.results}
    files = {key: file.name for key, result in results.items() if (file := comparison.recording(result)) is not None}
    bins = sorted({episode for episode, _ in results})
    of_bins = [[files[bin, mode] for mode in comparison.modes if (bin, mode) in files] for bin in bins]
    return {
        "results": results,
        "bins": bins,
        "recordings": files,
        "rerun_bins": [shlex.join(["rerun", *names]) for names in of_bins if names],
        "rerun_each": [shlex.join(["rerun", name]) for name in files.values()],
    }
