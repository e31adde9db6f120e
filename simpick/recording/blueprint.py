"""The default layout of a recording: cell, cameras, timeline of the picks, plots and log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import PanelState

from simpick.recording.legend import LEGEND_PATH
from simpick.records import PickOutcome

_FAILURE_COLOURS = {
    PickOutcome.NOTHING_DETECTED: 0x78909CFF,
    PickOutcome.NO_GRASP: 0x8D6E63FF,
    PickOutcome.UNREACHABLE: 0x5C6BC0FF,
    PickOutcome.COLLISION: 0xE53935FF,
    PickOutcome.MISSED: 0xFB8C00FF,
    PickOutcome.SLIPPED: 0xFFB300FF,
    PickOutcome.DROPPED: 0xF4511EFF,
    PickOutcome.DOUBLE_PICK: 0xAB47BCFF,
    PickOutcome.EJECTED: 0xD81B60FF,
    PickOutcome.SIMULATION_FAULT: 0xB71C1CFF,
}
OUTCOME_COLOURS: Mapping[PickOutcome, int] = {PickOutcome.SUCCESS: 0x43A047FF, **_FAILURE_COLOURS}
"""RGBA of each outcome: green for success, one colour per kind of failure."""

_BACKGROUND = (24, 27, 32)
_LEGEND = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)

SERIES: Mapping[str, tuple[str, int]] = {
    "/pose_error/rotation_deg": ("rotation (deg)", 0x42A5F5FF),
    "/pose_error/translation_mm": ("translation (mm)", 0xFFA726FF),
    "/pose_error/mssd_mm": ("MSSD (mm)", 0xEF5350FF),
    "/gripper/contact_force_n": ("contact force (N)", 0x26C6DAFF),
    "/score/success_rate": ("success rate", 0x66BB6AFF),
    "/score/remaining": ("parts left", 0xBDBDBDFF),
}
"""Name and RGBA of each plotted series, by entity."""


@dataclass(frozen=True)
class RecordedCamera:
    """A camera that took images in this recording."""

    name: str
    path: str
    """Its entity, such as ``/world/cameras/overhead``."""
    has_depth: bool
    moves: bool
    """Whether it rides on a body that moves, so that its last image shows a view that is past."""


def default_blueprint(
    root: str,
    cameras: Sequence[RecordedCamera],
    *,
    hidden: Sequence[str],
    overlays: Sequence[str],
    eye: tuple[Sequence[float], Sequence[float]],
    near_eye: tuple[Sequence[float], Sequence[float]] | None,
    latencies: bool,
) -> rrb.Blueprint:
    """Return the layout of a recording of the model below `root`.

    `eye` holds where the viewer stands and where it looks (metres, world), `near_eye` the same for a close view of what
    the first camera sees; `hidden` are entities that the 3D views leave out, `overlays` entities that are projected
    into the images of cameras at rest. The first camera's image is always in sight, all others share tabs; wall-clock
    latencies have a plot only where they are recorded.
    """
    contents = [
        "$origin/**",
        *(f"- {path}/**" for path in hidden),
        *(f"- {camera.path}/{layer}/**" for camera in cameras for layer in ("rgb", "depth", "detections", "masks")),
    ]
    cell = _view_3d(root, "Cell", contents, eye)
    images: list[rrb.View] = [
        rrb.Spatial2DView(
            origin=camera.path,
            name=_title(camera.name),
            contents=["$origin/rgb", "$origin/masks", "$origin/detections/**", *([] if camera.moves else overlays)],
        )
        for camera in cameras
    ]
    images += [
        rrb.Spatial2DView(origin=camera.path, name=f"{_title(camera.name)} depth", contents=["$origin/depth"])
        for camera in cameras
        if camera.has_depth
    ]
    if near_eye is not None:
        without_cameras = [*contents, *(f"- {camera.path}/**" for camera in cameras)]
        images.insert(1, _view_3d(root, "Detections, estimates, truth", without_cameras, near_eye))
    top: list[rrb.View | rrb.Container] = [cell]
    if images:
        top.append(rrb.Vertical(images[0], *([rrb.Tabs(*images[1:])] if images[1:] else [])))
    picks = rrb.StateTimelineView(origin="/pick", name="Picks", contents=["/pick/stage", "/pick/outcome"])
    errors = rrb.TimeSeriesView(
        origin="/pose_error",
        name="Pose error",
        contents=["$origin/rotation_deg", "$origin/translation_mm", "$origin/mssd_mm"],
        plot_legend=_LEGEND,
    )
    plots = [
        rrb.TimeSeriesView(origin="/gripper", name="Grip", contents=["$origin/**", "/user/**"], plot_legend=_LEGEND),
        rrb.TimeSeriesView(
            origin="/score",
            name="Success",
            contents=["$origin/success_rate"],
            axis_y=rrb.ScalarAxis(range=(0.0, 1.05)),
            plot_legend=_LEGEND,
        ),
    ]
    if latencies:
        plots.append(
            rrb.TimeSeriesView(origin="/latency", name="Latency", contents=["$origin/**"], plot_legend=_LEGEND)
        )
    log = rrb.TextLogView(
        origin="/log",
        name="Log",
        contents=["$origin"],
        columns=rrb.TextLogColumns(timeline_columns=["sim_time", "pick"], text_log_columns=["LogLevel", "Body"]),
    )
    legend = rrb.TextDocumentView(origin=LEGEND_PATH, name="Legend")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*top, column_shares=[2, 1][: len(top)]),
            rrb.Horizontal(picks, errors, rrb.Tabs(*plots), rrb.Tabs(legend, log), column_shares=[4, 3, 3, 4]),
            row_shares=[7, 3],
        ),
        rrb.TimePanel(timeline="sim_time", state=PanelState.Collapsed),
        rrb.SelectionPanel(state=PanelState.Collapsed),
        rrb.BlueprintPanel(state=PanelState.Collapsed),
    )


def _view_3d(
    root: str, name: str, contents: Sequence[str], eye: tuple[Sequence[float], Sequence[float]]
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=root,
        name=name,
        contents=list(contents),
        background=rrb.Background(color=_BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=eye[0], look_target=eye[1], eye_up=[0.0, 0.0, 1.0]),
    )


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def log_styles(stream: rr.RecordingStream) -> None:
    """Give series and states their names and colours."""
    for path, (name, colour) in SERIES.items():
        style: list[rr.AsComponents] = [rr.SeriesLines(names=name, colors=colour, widths=1.5)]
        if not path.startswith("/gripper"):
            # One value a pick: a marker shows where it stands.
            style.append(rr.SeriesPoints(names=name, colors=colour, marker_sizes=4.0))
        stream.log(path, *style, static=True, strict=True)
    stream.log(
        "/pick/outcome",
        rr.StateConfiguration(
            values=[str(outcome) for outcome in OUTCOME_COLOURS],
            labels=[str(outcome).replace("_", " ") for outcome in OUTCOME_COLOURS],
            colors=list(OUTCOME_COLOURS.values()),
        ),
        static=True,
        strict=True,
    )
