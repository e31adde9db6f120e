"""A comparison's plots as SVG: one colour per mode, which colour-blind readers can distinguish."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from simpick.experiments.analysis.error_tolerance import ERROR_EDGES, success_by_error
from simpick.experiments.analysis.failure_causes import FailureCause, count_causes
from simpick.experiments.analysis.grasp_scores import PERCEPTION_STAGES
from simpick.experiments.analysis.paired import executed
from simpick.experiments.comparison import Comparison
from simpick.experiments.modes import parse_mode
from simpick.plotting import new_figure
from simpick.records import PickOutcome

ORACLE_COLOURS = {"oracle": "#3c4248", "oracle_noise": "#949ca4"}
HUES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
"""Okabe and Ito's colours, made for colour-blind readers."""
CAUSE_COLOURS = ("#88ccee", "#332288", "#cc6677", "#ddcc77", "#117733", "#bbbbbb")
STAGE_COLOURS = ("#5b6570", "#88ccee", "#44aa99", "#0072b2", "#ddcc77", "#aa4499")
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a939c",
    "axes.titlesize": 10.5,
    "svg.fonttype": "path",
}


def mode_colours(modes: Sequence[str]) -> dict[str, str]:
    """Return a colour per mode; ``NAME@K`` and ``NAME+closer`` get tints of the colour of ``NAME``."""
    hues: dict[str, str] = dict(ORACLE_COLOURS)
    colours: dict[str, str] = {}
    shades: Counter[str] = Counter()
    for mode in modes:
        name = parse_mode(mode).name
        if name not in hues:
            hues[name] = HUES[(len(hues) - len(ORACLE_COLOURS)) % len(HUES)]
        white = min(0.35 * shades[name], 0.7)
        shades[name] += 1
        red, green, blue = ((1 - white) * channel + white for channel in to_rgb(hues[name]))
        colours[mode] = to_hex((red, green, blue))
    return colours


def success_plot(comparison: Comparison) -> str:
    """Draw grasp success, first-try success and clearance with their intervals."""
    statistics, colours = comparison.statistics(), mode_colours(comparison.modes)
    keys = {"grasp_success": "grasp success", "first_try": "first-try success", "clearance": "clearance"}

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, 3, sharey=True)
        for axis, (key, title) in zip(axes, keys.items(), strict=True):
            for row, mode in enumerate(comparison.modes):
                interval = statistics.measures[mode][key]
                axis.plot([interval.low, interval.high], [row, row], color=colours[mode], linewidth=3, alpha=0.6)
                axis.plot(interval.value, row, "o", color=colours[mode], markersize=8)
                if np.isfinite(interval.value):
                    axis.annotate(
                        f"{interval.value:.0f}",
                        (interval.value, row),
                        (0, 8),
                        textcoords="offset points",
                        ha="center",
                        fontsize=9,
                    )
            axis.set(title=f"{title} [%]", xlim=(-3, 105), ylim=(len(comparison.modes) - 0.5, -0.7))
            axis.set_yticks(range(len(comparison.modes)), comparison.modes)
            axis.grid(axis="x", alpha=0.25)

    return _svg("success", draw, (9, 0.9 + 0.5 * len(comparison.modes)))


def time_plot(comparison: Comparison) -> str:
    """Draw the robot time per delivered part, motion and perception's stages stacked."""
    statistics, paired = comparison.statistics(), comparison.paired()

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for row, mode in enumerate(comparison.modes):
            picks = [pick for result in paired[mode] for pick in result.picks]
            successes = sum(pick.outcome is PickOutcome.SUCCESS for pick in picks)
            if not successes:
                axis.text(0, row, " nothing was delivered", va="center")
                continue
            motion_s = sum(p.motion_s for result in paired[mode] for p in executed(result))
            spent = [motion_s, *(sum(p.timings_s.get(s, 0.0) for p in picks) for s in PERCEPTION_STAGES)]
            left = 0.0
            for seconds, colour in zip(spent, STAGE_COLOURS, strict=True):
                axis.barh(row, seconds / successes, left=left, color=colour, height=0.62)
                left += seconds / successes
            axis.text(left, row, f"  {statistics.measures[mode]['mpph'].value:.0f} per hour", va="center", fontsize=9)
        axis.set_yticks(range(len(comparison.modes)), comparison.modes)
        axis.set(xlabel="seconds per delivered part", ylim=(len(comparison.modes) - 0.5, -0.5))
        axis.margins(x=0.16)
        _legend(figure, STAGE_COLOURS, ("motion", *PERCEPTION_STAGES))

    return _svg("time", draw, (9, 1.2 + 0.42 * len(comparison.modes)))


def errors_plot(comparison: Comparison) -> str:
    """Draw the distributions of pose errors at the moment of the pick."""
    paired, colours = comparison.paired(), mode_colours(comparison.modes)
    axes_of = {
        "rotation_deg": "rotation error [deg]",
        "translation_mm": "translation error [mm]",
        "depth_mm": "depth error [mm]",
    }

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, 3, sharey=True)
        for axis, (key, label) in zip(axes, axes_of.items(), strict=True):
            for mode in comparison.modes:
                errors = [abs(getattr(p.pose_error, key)) for r in paired[mode] for p in executed(r) if p.pose_error]
                if errors:
                    parsed = parse_mode(mode)
                    style = ":" if parsed.look_closer else "--" if parsed.hypotheses else "-"
                    # Smaller errors are shown at a tenth: zero has no place on a logarithmic axis.
                    axis.ecdf(np.maximum(errors, 0.1), color=colours[mode], linewidth=2, linestyle=style)
            axis.set_xscale("log")
            axis.set(xlabel=label, xlim=(0.09, 200), ylim=(0, 1.02))
            axis.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
            axis.grid(alpha=0.25)
        axes[0].set_ylabel("share of attempts")
        _legend(figure, [colours[mode] for mode in comparison.modes], comparison.modes)

    return _svg("errors", draw, (9, 3.4))


def error_tolerance_plot(comparison: Comparison) -> str:
    """Draw the share of grasps that delivered a part against the error of the pose behind them, per mode."""
    picks = {mode: [p for r in results for p in executed(r)] for mode, results in comparison.paired().items()}
    everyone = [pick for own in picks.values() for pick in own]
    colours = mode_colours(comparison.modes)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(comparison.modes), 2, sharex="col", sharey=True, squeeze=False)
        for row, mode in zip(axes, comparison.modes, strict=True):
            for axis, key in zip(row, ERROR_EDGES, strict=True):
                together = success_by_error(everyone, key)
                axis.plot([s.share for s in together], "o-", color="#d0d5da", markersize=3, linewidth=1.5, zorder=1)
                for k, own in enumerate(success_by_error(picks[mode], key)):
                    if own.attempts:
                        axis.plot([k, k], own.interval, color=colours[mode], linewidth=3, alpha=0.5)
                        axis.plot(k, own.share, "o", color=colours[mode], markersize=7)
                        axis.annotate(f"{own.attempts}", (k, 1.1), ha="center", fontsize=8.5, color="#59636e")
                axis.set_xticks(range(len(together)), [s.label for s in together])
                axis.set(ylim=(-0.06, 1.32), yticks=(0, 0.5, 1))
                axis.grid(axis="y", alpha=0.25)
            row[0].set_title(mode, loc="left", fontsize=10, color=colours[mode], fontweight="bold")
        for axis, key in zip(axes[-1], ERROR_EDGES, strict=True):
            axis.set_xlabel(key.replace("_", " error [") + "]")
        figure.supylabel("P(success | error)", fontsize=10)

    return _svg("error_tolerance", draw, (9, 0.8 + 1.35 * len(comparison.modes)))


def causes_plot(comparison: Comparison) -> str:
    """Draw the causes of failure per 100 picks."""
    paired, failures = comparison.paired(), comparison.failures()

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for row, mode in enumerate(comparison.modes):
            picks = sum(len(result.picks) for result in paired[mode])
            left = 0.0
            for count, colour in zip(count_causes(failures[mode]).values(), CAUSE_COLOURS, strict=True):
                width = 100 * count / max(picks, 1)
                axis.barh(row, width, left=left, color=colour, height=0.62)
                left += width
            axis.text(left, row, f"  {left:.0f}", va="center", fontsize=9)
        axis.set_yticks(range(len(comparison.modes)), comparison.modes)
        axis.set(xlabel="failed picks per 100", ylim=(len(comparison.modes) - 0.5, -0.5))
        axis.margins(x=0.08)
        axis.set_xlim(left=0)
        _legend(figure, CAUSE_COLOURS, [cause.value for cause in FailureCause])

    return _svg("causes", draw, (9, 1.2 + 0.42 * len(comparison.modes)))


PLOTS: dict[str, Callable[[Comparison], str]] = {
    "success": success_plot,
    "time": time_plot,
    "errors": errors_plot,
    "error_tolerance": error_tolerance_plot,
    "causes": causes_plot,
}


def _legend(figure: Figure, colours: Sequence[str], labels: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=colour, label=label) for colour, label in zip(colours, labels, strict=True)]
    figure.legend(handles=patches, loc="outside upper left", ncols=min(len(patches), 6), frameon=False, fontsize=9)


def _svg(name: str, draw: Callable[[Figure], None], size: tuple[float, float]) -> str:
    """Return a drawing as SVG, the same for the same data; `name` makes its ids differ from those of other drawings."""
    with rc_context({**_STYLE, "svg.hashsalt": name}):
        figure = new_figure(*size)
        draw(figure)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return stream.getvalue()
