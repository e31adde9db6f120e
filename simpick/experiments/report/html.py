"""A comparison as one HTML file that needs nothing else: the answer first, then figures, plots and recordings."""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Iterable, Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template
from urllib.parse import quote

from simpick.experiments.analysis.error_tolerance import SuccessShare, success_by_pose
from simpick.experiments.analysis.failure_causes import count_causes
from simpick.experiments.analysis.grasp_scores import PERCEPTION_STAGES
from simpick.experiments.analysis.paired import MEASURES, Measure, PairedStatistics, best_mode, executed
from simpick.experiments.comparison import Comparison
from simpick.experiments.modes import parse_mode
from simpick.experiments.report.plots import PLOTS, mode_colours
from simpick.experiments.report.tables import DIFFERENCES, cause_cells, cause_headings, heading, number
from simpick.metrics.intervals import Interval

REPORT_FILE = "report.html"
TEMPLATE = Path(__file__).with_name("report_template.html")
_MEASURE = {measure.key: measure for measure in MEASURES}


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
    """Return the report as HTML."""
    statistics, config = comparison.statistics(), comparison.config
    parts = ", ".join(config.parts) or "the part library, mixed"
    inline = {f"plot_{name}": svg[svg.index("<svg") :] for name, svg in plots.items()}
    return Template(TEMPLATE.read_text()).substitute(
        inline,
        parts=escape(parts),
        setting=escape(
            f"{len(statistics.bins)} paired bins of {config.count}, {config.gripper} gripper, "
            f"{config.detections} detections, seeds from {config.seed}"
        ),
        answer="".join(f"<p>{sentence}</p>" for sentence in answer(comparison, statistics)),
        warning=_warning(comparison, statistics),
        figures=_figures(comparison, statistics),
        differences=_differences(statistics),
        stages=_stages(comparison),
        forgiveness=_forgiveness(comparison),
        causes=_causes(comparison),
        recordings=_recordings(comparison),
        noise=escape(f"{config.noise_deg:g} deg and {config.noise_mm:g} mm"),
        config=escape(json.dumps(comparison.store.provenance, indent=2)),
        versions=escape(", ".join(f"{name} {version(name)}" for name in ("simpick", "mujoco", "torch", "numpy"))),
        machine=escape(f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"),
    )


def answer(comparison: Comparison, statistics: PairedStatistics) -> list[str]:
    """Return what a reader wants to know first, as sentences in HTML."""
    if not statistics.bins:
        return ["No bin has been finished by every mode yet: there is nothing to compare."]
    measures = statistics.measures
    seeing = [mode for mode in statistics.modes if not parse_mode(mode).knows_truth]
    candidates = seeing or list(statistics.modes)
    best = best_mode(statistics, candidates)

    def told(mode: str, key: str) -> str:
        measure, interval = _MEASURE[key], measures[mode][key]
        unit = f" {measure.unit}" if measure.unit else ""
        bounds = f" ({number(interval.low, measure)} to {number(interval.high, measure)})"
        return escape(f"{number(interval.value, measure)}{unit}{'' if interval.low != interval.low else bounds}")

    lead = f"Of the {len(seeing)} modes that see only images, " if len(seeing) > 1 else ""
    sentences = [
        f"{lead}<strong>{escape(best)}</strong> {'picks best' if len(candidates) > 1 else 'was run'}: "
        f"<strong>{told(best, 'grasp_success')}</strong> of its grasps delivered a part, {told(best, 'clearance')} of "
        f"all parts were cleared, at <strong>{told(best, 'mpph')}</strong> picks an hour."
    ]
    if len(candidates) > 1:
        sentences.append("Best is the highest product of grasp success and clearance; picks an hour decide a tie.")
    if "oracle" in statistics.modes and best != "oracle":
        sentences.append(
            f"With true poses (oracle) the same cell reaches {told('oracle', 'grasp_success')} and "
            f"{told('oracle', 'mpph')} picks an hour: what lies between is what perception costs."
        )
    for difference in statistics.differences:
        others = {difference.mode, difference.against} - {best}
        if len(others) == 1 and others <= set(seeing) and not difference.measures["grasp_success"].excludes_zero:
            other = escape(others.pop())
            sentences.append(f"It is not told apart from {other} by grasp success: the interval includes zero.")
    if failures := comparison.failures()[best]:
        causes, total = count_causes(failures), len(failures)
        most, count = max(causes.items(), key=lambda blamed: blamed[1])
        sentences.append(
            f"Of the {total} failed looks of {escape(best)}, {count} ({100 * count / total:.0f} %) are blamed on "
            f"<strong>{most.value}</strong>."
        )
    return sentences


def _warning(comparison: Comparison, statistics: PairedStatistics) -> str:
    notes = []
    asked = comparison.config.episodes
    if len(statistics.bins) < asked:
        notes.append(
            f"Partial: {asked - len(statistics.bins)} of {asked} bins are left out: some mode has not finished "
            "them, or the physics diverged."
        )
    if 0 < len(statistics.bins) < 20:
        notes.append(f"{len(statistics.bins)} bins are few: intervals from so few bins tend to be too narrow.")
    fixed = [
        f"{_MEASURE[key].title} of {mode}"
        for mode, measures in statistics.measures.items()
        for key, interval in measures.items()
        if interval.has_no_width
    ]
    if fixed:
        notes.append(
            f"An interval of no width is no certainty: the bins all gave the same, so resampling cannot vary it. So "
            f"it is for {', '.join(fixed)}."
        )
    return "".join(f'<p class="note">{escape(note)}</p>' for note in notes)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of cells that are HTML already; the first cell of each row heads it."""
    lines = ["".join(f"<th scope='col'>{cell}</th>" for cell in head)]
    for first, *cells in rows:
        lines.append(f"<th scope='row'>{first}</th>" + "".join(f"<td>{cell}</td>" for cell in cells))
    return '<div class="wide"><table>' + "".join(f"<tr>{line}</tr>" for line in lines) + "</table></div>"


def _mode_cells(comparison: Comparison) -> list[str]:
    colours = mode_colours(comparison.modes)
    return [
        f'<span class="mode"><span class="dot" style="background:{colours[mode]}"></span>{escape(mode)}</span>'
        for mode in comparison.modes
    ]


def _figures(comparison: Comparison, statistics: PairedStatistics) -> str:
    def cell(mode: str, key: str) -> str:
        interval, measure = statistics.measures[mode][key], _MEASURE[key]
        if interval.low != interval.low:
            return number(interval.value, measure)
        bounds = f"{number(interval.low, measure)} to {number(interval.high, measure)}"
        return f"<b>{number(interval.value, measure)}</b><small>{bounds}</small>"

    rows = [[escape(heading(m)), *(cell(mode, m.key) for mode in statistics.modes)] for m in MEASURES]
    return _table(["", *_mode_cells(comparison)], rows)


def _differences(statistics: PairedStatistics) -> str:
    if not statistics.differences:
        return "<p>One mode was run; there is nothing to hold it against.</p>"
    shown = [measure for measure in MEASURES if measure.key in DIFFERENCES]

    def cell(interval: Interval, measure: Measure) -> str:
        if interval.low != interval.low:
            return "-"
        value = number(interval.value, measure, sign=True)
        bounds = " to ".join(number(bound, measure, sign=True) for bound in (interval.low, interval.high))
        return f"{f'<b>{value} *</b>' if interval.excludes_zero else value}<small>{bounds}</small>"

    rows = [
        [escape(f"{d.mode} − {d.against}"), *(cell(d.measures[m.key], m) for m in shown)]
        for d in statistics.differences
    ]
    return _table(["", *(escape(heading(measure)) for measure in shown)], rows)


def _stages(comparison: Comparison) -> str:
    rows = []
    for label, results in zip(_mode_cells(comparison), comparison.paired().values(), strict=True):
        looks = [pick for result in results for pick in result.picks]
        times = [
            1e3 * sum(p.timings_s.get(stage, 0.0) for p in looks) / max(len(looks), 1) for stage in PERCEPTION_STAGES
        ]
        rows.append([label, *(f"{ms:.1f}" for ms in times), f"{sum(times):.0f}"])
    return _table(["mean ms a look", *PERCEPTION_STAGES, "all"], rows)


def _forgiveness(comparison: Comparison) -> str:
    def cell(own: SuccessShare) -> str:
        if not own.attempts:
            return "-"
        low, high = (100 * bound for bound in own.interval)
        return f"<b>{own.successes} of {own.attempts}</b><small>{low:.0f} to {high:.0f} %</small>"

    rows, head = [], ()
    for label, results in zip(_mode_cells(comparison), comparison.paired().values(), strict=True):
        shares = success_by_pose([pick for result in results for pick in executed(result)])
        head = tuple(escape(share.label) for share in shares)
        rows.append([label, *map(cell, shares)])
    return _table(["grasps that delivered", *head], rows)


def _causes(comparison: Comparison) -> str:
    rows = []
    for label, failures in zip(_mode_cells(comparison), comparison.failures().values(), strict=True):
        avoidable = [failure.oracle_delivered for failure in failures if failure.oracle_delivered is not None]
        share = f"{sum(avoidable)} of {len(avoidable)}" if avoidable else "-"
        rows.append([label, *cause_cells(failures), share])
    return _table(["failed looks", *cause_headings(), "oracle delivered that part"], rows)


def _recordings(comparison: Comparison) -> str:
    results = {result.key: result for result in comparison.results}
    files = {key: file for key, result in results.items() if (file := comparison.recording(result)) is not None}
    rows, commands = [], []
    for episode in sorted({episode for episode, _ in results}):
        cells = []
        for mode in comparison.modes:
            result = results.get((episode, mode))
            if result is None:
                cells.append("-")
                continue
            text = f"{result.delivered}/{len(result.instances)}, {len(result.picks)} looks"
            file = files.get((episode, mode))
            cells.append(text if file is None else f'<a href="{quote(file.name)}">{text}</a>')
        rows.append([f"seed {comparison.config.seed + episode}", *cells])
        names = [files[episode, mode].name for mode in comparison.modes if (episode, mode) in files]
        if names:
            commands.append(_rerun(names))
    table = _table(["delivered, looks", *_mode_cells(comparison)], rows)
    if not commands:
        return table + "<p>No recordings: run with <code>--record --overwrite</code> to make them.</p>"
    together, single = escape("\n".join(commands)), escape("\n".join(_rerun([file.name]) for file in files.values()))
    return (
        f"{table}<p>Links lead to the recordings beside this file, also after the folder was moved. To watch all modes "
        f"of a bin side by side, in this folder:</p><pre>{together}</pre><p>Or one by one:</p><pre>{single}</pre>"
    )


def _rerun(names: Sequence[str]) -> str:
    """Return the command that opens these recordings, in the folder where they lie."""
    return shlex.join(["rerun", *names])
