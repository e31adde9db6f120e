"""What perception saw and believed, as layers of the recording: images, detections, estimated parts, the grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr
from jaxtyping import Bool, Float, UInt8

from simpick.assets.part import Part
from simpick.assets.shading import split_at_creases
from simpick.errors import UnknownNameError
from simpick.geometry.transforms import quaternion_from_matrix, transform_points
from simpick.recording.blueprint import RecordedCamera
from simpick.recording.entity_names import EntityNames
from simpick.recording.legend import DETECTION_RGB, TRUTH_RGB, estimate_rgb
from simpick.records import CameraFrame, Detection, InstanceTruth, PoseEstimate

DEPTH_UNITS_PER_M = 10_000
"""Depth is stored as 16-bit PNG in steps of 0.1 mm, up to 6.55 m: a tenth of the size of float32."""
_GOLDEN_ANGLE = 0.381966
_OVERLAY_OPACITY = 0.45
_GHOST_ALPHA = 110
_MOST_LABELS = 4
"""More boxes show their labels only under the pointer, so that they do not hide the image."""
_TCP_AXES_M = 0.06
_EDGE_ANGLE_RAD = np.radians(35)
_EDGE_WIDTH = 0.6
_OUTLINE_WIDTH = 1.0
_MOST_EDGES = 600
_NEAR_SHARE = 0.5
"""How far from what it sees the close view stands, as a share of the camera's own distance."""


@dataclass(frozen=True)
class LayerPaths:
    """The entities below which perception's layers lie."""

    cameras: Mapping[str, str]
    """Entity of each camera, by name."""
    detections: str
    """Their outlines in 3D."""
    estimates: str
    truth: str
    grasp: str
    moving_cameras: frozenset[str] = frozenset()
    """Names of the cameras that ride on a body that can move."""


class PerceptionLayers:
    """Logs perception's inputs and outputs at the stream's present time."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        paths: LayerPaths,
        parts: Sequence[Part],
        jpeg_quality: int,
    ) -> None:
        self._stream, self._quality, self._names = stream, jpeg_quality, EntityNames()
        self._camera_paths, self._moving_cameras = paths.cameras, paths.moving_cameras
        self._estimates_path, self._grasp_path = paths.estimates, paths.grasp
        self._detections_path, self._truth_path = paths.detections, paths.truth
        self._parts = {part.name: part for part in parts}
        self._frames: dict[str, CameraFrame] = {}
        self._with_depth: set[str] = set()
        self._feature_edges: dict[str, Float[np.ndarray, "_ 2 3"]] = {}
        self._ghosts: dict[str, dict[str, str]] = {}

    def frame(self, camera: str, frame: CameraFrame) -> None:
        """Log an image as JPEG, and its depth if it has any."""
        path = self._camera_path(camera)
        self._frames[camera] = frame
        jpeg = _encoded(".jpg", frame.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self._quality])
        self._log(f"{path}/rgb", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
        if frame.depth_m is not None:
            self._with_depth.add(camera)
            steps = np.clip(np.round(frame.depth_m * DEPTH_UNITS_PER_M), 0, np.iinfo(np.uint16).max)
            png = _encoded(".png", steps.astype(np.uint16), [])
            read = steps[steps > 0]
            # Colours span what is there: over rr's default, from the camera on, a bin is all one colour.
            shown = np.percentile(read, [1.0, 99.0]) if read.size else np.array([0.0, 1.0])
            image = rr.EncodedDepthImage(
                png,
                media_type="image/png",
                meter=float(DEPTH_UNITS_PER_M),
                depth_range=(float(shown[0]), float(shown[1]) + 1.0),
                colormap="viridis",
            )
            self._log(f"{path}/depth", image)

    @property
    def edge_paths(self) -> list[str]:
        """Return the entities of the estimates' edges, one a mode."""
        return [f"{self._mode_path(mode)}/edges" for mode in self._ghosts]

    @property
    def recorded_cameras(self) -> list[RecordedCamera]:
        """Return the cameras whose images were logged, in the model's order, ``overhead`` first."""
        names = sorted((name for name in self._camera_paths if name in self._frames), key=lambda n: n != "overhead")
        return [
            RecordedCamera(name, self._camera_paths[name], name in self._with_depth, name in self._moving_cameras)
            for name in names
        ]

    def detections(self, camera: str, detections: Sequence[Detection]) -> None:
        """Log boxes, outlines and masks over the camera's image, and the outlines in 3D where the image has depth.

        Boxes and outlines have the detections' colour; masks differ from each other.
        """
        path = self._camera_path(camera)
        boxes = np.array([detection.box_xyxy_px for detection in detections]).reshape(-1, 4)
        self._log(
            f"{path}/detections",
            rr.Boxes2D(
                mins=boxes[:, :2],
                sizes=boxes[:, 2:] - boxes[:, :2],
                colors=[DETECTION_RGB],
                labels=[f"{detection.part} {detection.score:.2f}" for detection in detections],
                show_labels=len(detections) <= _MOST_LABELS,
            ),
        )
        self._log_outlines(camera, [detection.mask for detection in detections if detection.mask is not None])
        masks = [detection.mask for detection in detections if detection.mask is not None]
        frame = self._frames.get(camera)
        shape = masks[0].shape if masks else None if frame is None else frame.rgb.shape[:2]
        if shape is None:
            return
        ids = np.zeros(shape, np.uint8)
        # Painted from the last to the first, so that the best detection lies on top; 255 labels are more than enough.
        for k in reversed(range(len(detections))):
            mask = detections[k].mask
            if mask is not None:
                ids[mask] = k % 255 + 1
        self._log(f"{path}/masks", rr.SegmentationImage(ids, opacity=_OVERLAY_OPACITY))

    def log_mask_colours(self, root: str) -> None:
        """Give the masks' labels their colours; once a recording."""
        context = [rr.AnnotationInfo(id=0, color=(0, 0, 0, 0))]
        context += [rr.AnnotationInfo(id=k + 1, color=_colour(k)) for k in range(255)]
        self._stream.log(root, rr.AnnotationContext(context), static=True, strict=True)

    def estimates(self, T_world_camera: Float[np.ndarray, "4 4"], estimates: Sequence[PoseEstimate]) -> None:
        """Show the estimated parts as translucent meshes and edges, in the place of those of the same mode before.

        No estimates at all clear those of every mode.
        Viewers draw the edges over the camera's image too, where they show how well an estimate fits.
        """
        modes = dict.fromkeys(estimate.mode for estimate in estimates) if estimates else dict(self._ghosts)
        for mode in modes:
            of_mode = [estimate for estimate in estimates if estimate.mode == mode]
            if mode not in self._ghosts:
                self._ghosts[mode] = {}
                self._names.path(self._mode_path(mode), "edges")
            ghosts = self._ghosts[mode]
            for estimate in of_mode:
                if estimate.part not in ghosts:
                    ghosts[estimate.part] = self._log_ghost(mode, estimate.part, len(self._ghosts) - 1)
            for part, path in ghosts.items():
                chosen = [estimate for estimate in of_mode if estimate.part == part]
                self._log(path, *_instances(T_world_camera, chosen))
            self._log_edges(mode, T_world_camera, of_mode)

    def truth(self, truth: Sequence[InstanceTruth]) -> None:
        """Show the edges of the parts in the bin at their true poses."""
        shown = [instance for instance in truth if instance.in_bin and instance.part in self._parts]
        strips = [transform_points(instance.T_world_part, self._edges(instance.part)) for instance in shown]
        self._log(self._truth_path, _edge_strips(strips, TRUTH_RGB))

    @property
    def near_eye(self) -> tuple[list[float], list[float]] | None:
        """Return where to stand and look to see what the first camera at rest sees from nearby; None without image."""
        names = [camera.name for camera in self.recorded_cameras if not camera.moves]
        if not names:
            return None
        frame = self._frames[names[0]]
        T, depth_m = frame.T_world_camera, frame.depth_m
        distance_m = 1.0 if depth_m is None or not depth_m.any() else float(np.median(depth_m[depth_m > 0]))
        target = T[:3, 3] + distance_m * T[:3, 2]
        # From the side of the image's lower edge, so steeply that the bin's wall hides nothing.
        away = 0.4 * T[:3, 1] - T[:3, 2]
        eye = target + _NEAR_SHARE * distance_m * away / np.linalg.norm(away)
        return eye.tolist(), target.tolist()

    def grasp(self, T_world_tcp: Float[np.ndarray, "4 4"]) -> None:
        """Show the chosen gripper pose as axes: x red (closing), z blue (approach)."""
        self._log(
            self._grasp_path,
            rr.Transform3D(translation=T_world_tcp[:3, 3], quaternion=rr.Quaternion(xyzw=_xyzw(T_world_tcp[:3, :3]))),
            rr.TransformAxes3D(_TCP_AXES_M),
        )

    def _log_edges(
        self, mode: str, T_world_camera: Float[np.ndarray, "4 4"], estimates: Sequence[PoseEstimate]
    ) -> None:
        strips = [
            transform_points(T_world_camera @ estimate.T_camera_part, self._edges(estimate.part))
            for estimate in estimates
        ]
        colour = estimate_rgb(list(self._ghosts).index(mode))
        self._log(f"{self._mode_path(mode)}/edges", _edge_strips(strips, colour))

    def _log_outlines(self, camera: str, masks: Sequence[Bool[np.ndarray, "height width"]]) -> None:
        frame = self._frames.get(camera)
        outlines = [(mask, outline) for mask in masks for outline in _outlines(mask)]
        width = rr.Radius.ui_points(_OUTLINE_WIDTH)
        flat = rr.LineStrips2D([outline for _, outline in outlines], colors=[DETECTION_RGB], radii=width)
        self._log(f"{self._camera_path(camera)}/detections/outlines", flat)
        if frame is None or frame.depth_m is None:
            return
        # A mask has no depth: the simulator's image lends its own, for the eye only.
        strips = [transform_points(frame.T_world_camera, _at_depth(frame, outline, mask)) for mask, outline in outlines]
        path = f"{self._detections_path}/{rr.escape_entity_path_part(camera)}"
        self._log(path, rr.LineStrips3D(strips, colors=[DETECTION_RGB], radii=width))

    def _edges(self, part: str) -> Float[np.ndarray, "_ 2 3"]:
        """Return the edges where a part's surface bends, the sharpest first if there are very many."""
        if part not in self._feature_edges:
            mesh = self._parts[part].mesh
            angles = mesh.face_adjacency_angles
            order = np.argsort(-angles, kind="stable")
            chosen = order[angles[order] > _EDGE_ANGLE_RAD][:_MOST_EDGES]
            self._feature_edges[part] = np.asarray(mesh.vertices)[mesh.face_adjacency_edges[chosen]]
        return self._feature_edges[part]

    def _mode_path(self, mode: str) -> str:
        return f"{self._estimates_path}/{rr.escape_entity_path_part(mode)}"

    def _log_ghost(self, mode: str, part: str, mode_index: int) -> str:
        if part not in self._parts:
            raise UnknownNameError("part in this episode", part, self._parts, "Pass it to start_episode(parts=...).")
        path = self._names.path(self._mode_path(mode), part)
        vertices, normals, faces = split_at_creases(self._parts[part].mesh)
        self._stream.log(
            path,
            rr.Mesh3D(
                vertex_positions=vertices.astype(np.float32),
                triangle_indices=faces.astype(np.uint32),
                vertex_normals=normals.astype(np.float32),
                albedo_factor=(*estimate_rgb(mode_index), _GHOST_ALPHA),
            ),
            static=True,
            strict=True,
        )
        return path

    def _camera_path(self, camera: str) -> str:
        if camera not in self._camera_paths:
            raise UnknownNameError("camera", camera, self._camera_paths)
        return self._camera_paths[camera]

    def _log(self, path: str, *archetypes: rr.AsComponents) -> None:
        self._stream.log(path, *archetypes, strict=True)


def _edge_strips(strips: Sequence[Float[np.ndarray, "_ 2 3"]], rgb: tuple[int, int, int]) -> rr.LineStrips3D:
    """Return the edges of several parts as thin lines."""
    points = np.concatenate([np.zeros((0, 2, 3)), *strips]).astype(np.float32)
    return rr.LineStrips3D(points, colors=[rgb], radii=rr.Radius.ui_points(_EDGE_WIDTH))


def _at_depth(
    frame: CameraFrame, outline: Float[np.ndarray, "n 2"], mask: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "n 3"]:
    """Return an outline in the camera's frame, at the median depth of the mask's pixels."""
    assert frame.depth_m is not None
    return frame.camera.back_project(outline, np.full(len(outline), float(np.median(frame.depth_m[mask]))))


def _outlines(mask: Bool[np.ndarray, "height width"]) -> list[Float[np.ndarray, "_ 2"]]:
    """Return the closed outlines of a mask, in pixels."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [np.concatenate([line, line[:1]])[:, 0].astype(float) + 0.5 for line in found]


def _instances(
    T_world_camera: Float[np.ndarray, "4 4"], estimates: Sequence[PoseEstimate]
) -> tuple[rr.AsComponents, ...]:
    if not estimates:
        # An empty list of instances would be drawn once, untransformed; a mesh scaled to nothing is not seen.
        return (
            rr.InstancePoses3D(
                translations=[[0.0, 0.0, 0.0]], quaternions=[rr.Quaternion.identity()], scales=[[0.0] * 3]
            ),
        )
    Ts_world_part = T_world_camera @ np.stack([estimate.T_camera_part for estimate in estimates])
    return (
        rr.InstancePoses3D(
            translations=Ts_world_part[:, :3, 3].astype(np.float32),
            quaternions=_xyzw(Ts_world_part[:, :3, :3]).astype(np.float32),
            scales=np.ones((len(estimates), 3), np.float32),
        ),
        rr.AnyValues(score=np.array([estimate.score for estimate in estimates], np.float64)),
    )


def _xyzw(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    return quaternion_from_matrix(R)[..., [1, 2, 3, 0]]


def _encoded(suffix: str, image: np.ndarray, options: list[int]) -> bytes:
    done, buffer = cv2.imencode(suffix, np.ascontiguousarray(image), options)
    if not done:
        raise ValueError(f"OpenCV could not encode an image of shape {image.shape} as {suffix}")
    return buffer.tobytes()


def _colour(index: int) -> tuple[int, int, int]:
    """Return a bright colour; successive indices lie far apart in hue (steps of the golden angle)."""
    hue = index * _GOLDEN_ANGLE % 1.0
    pixel: UInt8[np.ndarray, "1 1 3"] = np.array([[[round(hue * 180) % 180, 190, 255]]], np.uint8)
    r, g, b = (int(value) for value in cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0])
    return (r, g, b)
