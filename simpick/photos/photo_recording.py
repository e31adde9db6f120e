"""A rerun recording of photographs: images, detections, estimated parts in 3D and over the image, and the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import PanelState

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.photos.outputs import ImageAnswer
from simpick.recording.perception_layers import LayerPaths, PerceptionLayers
from simpick.recording.pinhole_archetype import pinhole_archetype
from simpick.recording.recording_file import RecordingFile

_ROOT, _CAMERA = "/world", "/world/camera"
_JPEG_QUALITY = 90


class PhotoRecording(Closing):
    """Writes an ``.rrd`` file with one step of the timeline ``image`` per image; a context manager.

    The camera is the world's origin.
    """

    def __init__(self, path: Path, parts: Sequence[Part], *, overwrite: bool = False) -> None:
        """Open the recording.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        self._file = RecordingFile(path, overwrite=overwrite)
        self._stream = self._file.open(path.stem)
        paths = LayerPaths(
            {"camera": _CAMERA},
            detections=f"{_ROOT}/detections",
            estimates=f"{_ROOT}/estimates",
            truth=f"{_ROOT}/truth",
            grasp=f"{_ROOT}/grasp",
        )
        self._layers = PerceptionLayers(self._stream, paths, parts, _JPEG_QUALITY)
        self._stream.log(_ROOT, rr.ViewCoordinates.RDF, static=True, strict=True)
        self._layers.log_mask_colours(_ROOT)

    def add(self, index: int, answer: ImageAnswer) -> None:
        """Log one image and what was found in it."""
        self._file.require_room()
        self._stream.set_time("image", sequence=index)
        if answer.poses is None:
            self._text(f"{answer.name}: {answer.error}", "ERROR")
            return
        frame = answer.poses.frame
        self._stream.log(_CAMERA, pinhole_archetype(frame.camera), strict=True)
        self._layers.frame("camera", frame)
        self._layers.detections("camera", answer.poses.detections)
        self._layers.estimates(frame.T_world_camera, answer.poses.estimates)
        for estimate, checks in zip(answer.poses.estimates, answer.checks, strict=True):
            reasons = "; ".join(checks.reasons) or "nothing speaks against it"
            level = "WARN" if checks.reasons else "INFO"
            self._text(f"{answer.name}: {estimate.part} {estimate.score:.2f}: {reasons}", level)
        self._stream.flush(timeout_sec=0.0)

    def close(self) -> None:
        """Write the layout and close the file; may be called again."""
        self._stream.send_blueprint(self._layout())
        self._file.close()

    def _text(self, text: str, level: str) -> None:
        self._stream.log("/log", rr.TextLog(text, level=level), strict=True)

    def _layout(self) -> rrb.Blueprint:
        overlays = self._layers.edge_paths
        image = rrb.Spatial2DView(
            origin=_CAMERA, name="Image", contents=["$origin/rgb", "$origin/masks", "$origin/detections/**", *overlays]
        )
        hidden = [f"- {_CAMERA}/{layer}/**" for layer in ("masks", "detections")]
        space = rrb.Spatial3DView(origin=_ROOT, name="Parts and camera", contents=["$origin/**", *hidden])
        log = rrb.TextLogView(origin="/log", name="Checks", contents=["$origin"])
        return rrb.Blueprint(
            rrb.Vertical(rrb.Horizontal(image, space, column_shares=[3, 2]), log, row_shares=[4, 1]),
            rrb.TimePanel(timeline="image", state=PanelState.Collapsed),
            rrb.SelectionPanel(state=PanelState.Collapsed),
            rrb.BlueprintPanel(state=PanelState.Collapsed),
        )
