"""``simpick estimate``: poses of CAD parts in photographs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simpick.assets.units import Unit
from simpick.config import Config, PositiveInt
from simpick.errors import ConfigError, OutputError, SimpickError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    from simpick.estimators.base import Detector
    from simpick.photos import Calibration, PhotoEstimator, PhotoPoses, PoseChecks
    from simpick.photos.image_files import ImageFile, ImageReader
    from simpick.photos.outputs import ImageAnswer
    from simpick.records import Detection
    from simpick.terminal import Console


@dataclass(frozen=True)
class Estimate(Config):
    """Estimate poses of CAD parts in photographs.

    Writes poses.json and poses.csv in the frame and unit of the CAD files, an overlay per image and a recording.
    """

    images: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="IMAGE ...", help_behavior_hint="(required)")
    ]
    """Image files, folders of images, or videos."""
    camera: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE|FX FY CX CY")]
    """Calibration file (OpenCV, ROS, BOP, RealSense) or four numbers; pixel centres at integers, as in OpenCV."""
    part: Annotated[tuple[str, ...], tyro.conf.arg(metavar="CAD ...")]
    """Mesh files, names of parts, or onboarding files (.simpick)."""
    mode: str = "refined"
    """retrieval, coarse, fine, refined, retrieval_refined, or another package's; NAME@K: K hypotheses."""
    detections: str = "learned"
    """learned, another package's detector, a JSON file, or boxes (see --boxes)."""
    boxes: Annotated[
        tuple[float, ...], tyro.conf.arg(metavar="X1 Y1 X2 Y2 ...", help_behavior_hint="(default: none)")
    ] = ()
    """Boxes of the part in pixels, four numbers each, in every image; a mask is found in each: learned, or GrabCut."""
    count: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: all)")] = None
    """How many of each part to report per image: the most certain ones; improbable ones too, if there are no others."""
    unit: Unit = "auto"
    """Unit of mesh files; auto chooses by plausible size and reports which."""
    rectified: bool = False
    """The images are undistorted already: ignore the file's distortion (ROS: use its projection matrix)."""
    half_pixel: bool = False
    """The camera has pixel centres at integer + 0.5, as in COLMAP and simpick, not at integers."""
    every: PositiveInt = 1
    """Videos: use every N-th frame."""
    show_rivals: bool = False
    """Also print other poses that fit nearly as well, and draw their contours in white."""
    out: Path = Path("logs/estimate")
    """Folder to write to."""
    overwrite: bool = False
    """Replace earlier results in that folder."""

    def _check_rules(self) -> None:
        if len(self.camera) not in (1, 4):
            raise ConfigError(
                f"camera must be a file or four numbers FX FY CX CY, got {' '.join(self.camera)!r}; give the camera "
                "matrix in pixels (FX, FY on its diagonal, CX, CY in its last column), or a calibration file"
            )
        if self.boxes and self.detections not in ("learned", "boxes"):
            raise ConfigError(f"boxes are detections already; leave out --detections {self.detections}")
        if self.detections == "boxes" and not self.boxes:
            raise ConfigError("detections boxes must come with --boxes X1 Y1 X2 Y2, in pixels")
        if self.boxes and len(self.part) != 1:
            raise ConfigError(
                f"boxes do not state their part and there are {len(self.part)}; give --detections FILE with a part "
                "for each box"
            )
        if not (self.images and self.part):
            raise ConfigError("images and part must each be one or more")

    def run(self) -> int:
        """Estimate, print the poses, and write the files; return 1 if an image could not be answered."""
        from simpick.photos.image_files import ImageReader, find_images
        from simpick.photos.outputs import PoseFiles, describe_part
        from simpick.photos.parts import load_parts
        from simpick.photos.photo_estimator import PhotoEstimator
        from simpick.photos.photo_recording import PhotoRecording
        from simpick.terminal import Console, track

        console = Console()
        if (self.out / "poses.json").exists() and not self.overwrite:
            raise OutputError(f"{self.out} holds poses already. Choose another folder with --out, or pass --overwrite.")
        calibration = self._calibration()
        console.print_line(calibration.describe())
        images = find_images(self.images, every=self.every)
        parts = load_parts(self.part, self.unit)
        for part, given in zip(parts, self.part, strict=True):
            console.print_line(describe_part(part, given, self.unit))
        source = self._detections([part.name for part in parts], console)
        found = failed = 0
        with (
            ImageReader() as reader,
            PhotoEstimator(parts, self.mode) as estimator,
            PhotoRecording(self.out / "poses.rrd", parts, overwrite=self.overwrite) as recording,
        ):
            files = PoseFiles(parts, self.mode, probabilities=estimator.gives_probabilities)
            sizes: list[tuple[int, int]] = []
            try:
                for k, image in enumerate(track(images, "images", console=console)):
                    answer = self._answer(image, reader, calibration, estimator, source, sizes)
                    recording.add(k, answer)
                    files.add(answer)
                    _print(console, answer, rivals=self.show_rivals)
                    failed += answer.poses is None
                    found += 0 if answer.poses is None else len(answer.poses.estimates)
            finally:
                files.write(self.out)  # Also what was finished before an interruption.
        console.print_line(f"{found} poses in {len(images)} images, {failed} without an answer: {self.out}/poses.json")
        return 1 if failed else 0

    def _calibration(self) -> Calibration:
        import numpy as np

        from simpick.photos import Calibration, read_calibration

        if len(self.camera) == 1:
            if self.half_pixel:
                raise ConfigError("half-pixel is for four numbers; the formats of camera files have integer centres")
            return read_calibration(Path(self.camera[0]), rectified=self.rectified)
        try:
            fx, fy, cx, cy = map(float, self.camera)
        except ValueError:
            raise ConfigError(f"camera must be four numbers FX FY CX CY, got {' '.join(self.camera)!r}") from None
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        return Calibration.from_K(K, pixel_centres="half" if self.half_pixel else "integer", source="--camera")

    def _detections(
        self, names: list[str], console: Console
    ) -> Callable[[ImageFile, int, int], Detector | Sequence[Detection]]:
        """Return what gives the detector, or the detections, of an image of some height and width."""
        from simpick.estimators.detections import photo_detector
        from simpick.photos.photo_detections import DetectionFile, boxes_from_numbers

        if self.boxes:
            boxes = boxes_from_numbers(self.boxes, names[0])
            return lambda image, height, width: boxes
        if Path(self.detections).suffix == ".json":
            file = DetectionFile(Path(self.detections), names)
            if file.note:
                console.print_line(f"note: {file.note}")
            return file.of
        detector = photo_detector(self.detections, counted=self.count is not None)
        return lambda image, height, width: detector

    def _answer(
        self,
        image: ImageFile,
        reader: ImageReader,
        calibration: Calibration,
        estimator: PhotoEstimator,
        source: Callable[[ImageFile, int, int], Detector | Sequence[Detection]],
        sizes: list[tuple[int, int]],
    ) -> ImageAnswer:
        """Return one image's poses with its overlay written; an error of this image does not end the others.

        `sizes` are those of the images before that the camera suits; this one's is added.
        """
        from simpick.photos.outputs import ImageAnswer

        try:
            photo = reader.read(image, calibration.size)
            height, width = photo.rgb.shape[:2]
            camera = calibration.of_size(width, height)
            sizes.append((width, height))
            poses = estimator.estimate(photo.rgb, camera, source(image, height, width), count=self.count)
            checks = estimator.checks(poses)
            self._draw(image, estimator, poses, checks)
        except OutputError:
            raise
        except SimpickError as error:
            return ImageAnswer(str(image), image.name, None, (), (), str(error))
        notes = [*photo.notes, *_other_size(sizes), *self._missing(poses), *estimator.doubts(poses)]
        return ImageAnswer(str(image), image.name, poses, checks, notes)

    def _draw(
        self, image: ImageFile, estimator: PhotoEstimator, poses: PhotoPoses, checks: Sequence[PoseChecks]
    ) -> None:
        from simpick.cli.outputs import write_image
        from simpick.photos.overlay import Overlay

        overlay, frame = Overlay(poses.frame), poses.frame
        for k, (estimate, own) in enumerate(zip(poses.estimates, checks, strict=True)):
            part = estimator.parts[estimate.part]
            for rival in own.rivals if self.show_rivals else ():
                overlay.draw_rival(estimator.depth(part.name, rival.T_camera_cad @ part.T_cad_part, frame))
            overlay.draw_contours(k, part, estimator.depth(part.name, estimate.T_camera_part, frame))
        for k, estimate in enumerate(poses.estimates):
            overlay.draw_axes(k, estimator.parts[estimate.part], estimate)
        write_image(self.out / "overlays" / f"{image.name}.png", overlay.image)

    def _missing(self, poses: PhotoPoses) -> list[str]:
        """Return why there are fewer estimates than one may expect."""
        if not poses.detections and Path(self.detections).suffix == ".json":
            return [f"{self.detections} lists no detection of this image: neither by its file name nor by its number"]
        if not poses.detections:
            return [
                "nothing was detected. Look whether the part is in the image and large enough; give boxes (--boxes "
                "X1 Y1 X2 Y2) or your own detections (--detections FILE)"
            ]
        unanswered = len(poses.detections) - len(poses.estimates)
        if unanswered and self.count is None:
            return [f"{unanswered} detections have no estimate: outside the image, or too few pixels"]
        return []


def _other_size(sizes: list[tuple[int, int]]) -> list[str]:
    """Return a sentence if the last image is not as large as the first, though both have one camera."""
    (width, height), (first_width, first_height) = sizes[-1], sizes[0]
    if (width, height) == (first_width, first_height):
        return []
    return [
        f"{width} x {height} px, where the first image has {first_width} x {first_height} px and the same camera: its "
        "poses are right only if it was cropped at its right or lower side. State width and height in a camera file to "
        "have other sizes refused"
    ]


def _print(console: Console, answer: ImageAnswer, *, rivals: bool) -> None:
    if answer.poses is None:
        console.print_line(f"{answer.file}: no answer: {answer.error}")
        return
    seconds = ", ".join(f"{name} {value:.2f} s" for name, value in answer.poses.timings_s.items())
    console.print_line(f"{answer.file}: {len(answer.poses.estimates)} poses ({seconds})")
    for note in answer.notes:
        console.print_line(f"  note: {note}")
    for estimate, checks in zip(answer.poses.estimates, answer.checks, strict=True):
        where = _numbers(estimate.T_camera_cad_units[:3, 3])
        console.print_line(f"  {estimate.part} {estimate.score:.2f} at ({where}): {'; '.join(checks.reasons) or 'ok'}")
        for rival in checks.rivals if rivals else ():
            at = _numbers(rival.T_camera_cad[:3, 3] / estimate.metres_per_cad_unit)
            console.print_line(f"    rival {rival.share:.2f} at ({at}), {rival.rotation_deg:.0f} degrees away")


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values.tolist())
