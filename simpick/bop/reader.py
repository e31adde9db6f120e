"""Lazy reading of BOP data sets in the classic and multi-sensor layouts.

``BopDataset(Path("datasets/ycbv"))`` reads folder names only; models, scene files and images are read on demand. All
results are in simpick's conventions (see `simpick.bop.conventions`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from simpick.bop.models import BopModels
from simpick.bop.scene_reader import BopScene
from simpick.bop.targets import BopTarget, read_targets
from simpick.errors import DatasetError


class BopDataset:
    """A BOP data set on disk.

    Args:
        root: the data set's folder, which holds ``models`` and the splits.
        split: folder of scenes, such as ``test``, ``val`` or ``train_pbr``; if None, ``test``, or the only one.
        camera: which sensor of a multi-sensor data set, such as ``cam1``; if None, the classic file names, or the only
            sensor there is.
        models: folder of models; if None, ``models``, ``models_cad`` (T-LESS) or ``models_eval``,
            the first that exists.
    """

    def __init__(
        self, root: Path | str, split: str | None = None, *, camera: str | None = None, models: str | None = None
    ) -> None:
        self.root = Path(root)
        if not self.root.is_dir():
            raise DatasetError(
                f"no folder {self.root}. Give the folder of a BOP data set, the one that holds models and test."
            )
        self.split = self._choose_split(split)
        self.camera = self._choose_camera(camera)
        eval_folder = self.root / "models_eval"
        self.models = BopModels(self._choose_models(models), eval_folder if eval_folder.is_dir() else None)

    @property
    def name(self) -> str:
        """Return the data set's name: its folder's."""
        return self.root.resolve().name

    @cached_property
    def scene_ids(self) -> tuple[int, ...]:
        """Return the ids of the split's scenes, ascending."""
        return tuple(sorted(int(folder.name) for folder in _scene_folders(self.root / self.split)))

    def scene(self, scene_id: int) -> BopScene:
        """Return one scene. Raises `DatasetError` if there is no scene with this id."""
        folder = self.root / self.split / f"{scene_id:06d}"
        if not folder.is_dir():
            ids = ", ".join(map(str, self.scene_ids))
            raise DatasetError(f"{self.root / self.split}: has no scene {scene_id} ({folder.name}). Scenes: {ids}.")
        return BopScene(folder, scene_id, self.models, self.camera)

    def __iter__(self) -> Iterator[BopScene]:
        return (self.scene(scene_id) for scene_id in self.scene_ids)

    def targets(self, file_name: str = "test_targets_bop19.json") -> tuple[BopTarget, ...]:
        """Return the listed test targets. Raises `DatasetError` if they name a scene that the split does not have."""
        path = self.root / file_name
        targets = read_targets(path)
        for target in targets:
            if target.scene_id not in self.scene_ids:
                raise DatasetError(
                    f"{path}: names scene {target.scene_id}, which split {self.split!r} does not have. Choose the "
                    "split that the targets belong to."
                )
        return targets

    def _choose_split(self, split: str | None) -> str:
        splits = sorted(folder.name for folder in self.root.iterdir() if folder.is_dir() and _scene_folders(folder))
        if split is None:
            split = "test" if "test" in splits or len(splits) != 1 else splits[0]
        if split not in splits:
            raise DatasetError(
                f"{self.root}: has no split {split!r}, that is no folder {split}/ with scenes such as 000001. Splits: "
                f"{', '.join(splits) or 'none'}."
            )
        return split

    def _choose_camera(self, camera: str | None) -> str:
        folder = min(_scene_folders(self.root / self.split))
        # classic: scene_camera.json; multi-sensor: scene_camera_cam1.json
        cameras = sorted(
            path.stem.removeprefix("scene_camera").lstrip("_") for path in folder.glob("scene_camera*.json")
        )
        if not cameras:
            raise DatasetError(
                f"no file {folder / 'scene_camera.json'}, nor scene_camera_<camera>.json. Each scene needs one; fetch "
                "the scene again, or choose another split."
            )
        if camera is None and ("" in cameras or len(cameras) == 1):
            return cameras[0]
        if camera not in cameras:
            asked = "has several cameras" if camera is None else f"has no camera {camera!r}"
            raise DatasetError(
                f"{folder}: {asked}. Choose one with camera: {', '.join(name or '(none)' for name in cameras)}."
            )
        return camera

    def _choose_models(self, models: str | None) -> Path:
        present = sorted(folder.name for folder in self.root.glob("models*") if folder.is_dir())
        models = models or next((name for name in ("models", "models_cad", "models_eval") if name in present), "models")
        if models not in present:
            raise DatasetError(
                f"{self.root}: has no folder {models}. Model folders: {', '.join(present) or 'none'}. Fetch the data "
                "set's models archive, or choose another with models."
            )
        return self.root / models


def _scene_folders(split: Path) -> list[Path]:
    """Return the folders of a split that are named by a number."""
    return [folder for folder in split.iterdir() if folder.is_dir() and folder.name.isdigit()]
