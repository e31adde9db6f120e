"""Batches that are cut on the device: the crops of the loaders' batches, from seed and step alone."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from simpick.errors import ConfigError, DatasetError
from simpick.rendering.camera_effects import CameraEffects
from simpick.training.detector import device_views
from simpick.training.detector.batches import CropBatch, crop_batches
from simpick.training.detector.bin_files import bin_file, write_bin
from simpick.training.detector.config import CropConfig, DetectorTrainConfig
from simpick.training.detector.device_batches import device_batches
from simpick.training.detector.device_views import DeviceViews, do_views_fit, views_bytes
from simpick.training.graceful_stop import GracefulStop
from tests.training.detector.conftest import TINY_DATA, TINY_TRAINING

pytestmark = pytest.mark.render
CPU = torch.device("cpu")
QUIET = CropConfig(size_px=64, effects=CameraEffects(noise_share=0.0, jpeg_share=0.0))
CONFIG = replace(TINY_TRAINING, batch=5, crops_per_view=2, crops=QUIET)


@pytest.fixture
def files(tiny_bins: Path) -> list[Path]:
    if not bin_file(tiny_bins, TINY_DATA, "train", 1).exists():
        write_bin(tiny_bins, TINY_DATA, "train", 1)
    return [bin_file(tiny_bins, TINY_DATA, "train", index) for index in (0, 1)]


def batch_of(config: DetectorTrainConfig, files: list[Path], step: int = 0) -> CropBatch:
    with DeviceViews(config, lambda: files, CPU, readers=2) as views:
        views.wait(GracefulStop())
        return next(device_batches(config, views, step))


@pytest.mark.parametrize("step", [0, 7])
def test_device_and_loaders_cut_the_same_crops(files: list[Path], step: int) -> None:
    here, there = batch_of(CONFIG, files, step), next(crop_batches(CONFIG, lambda: files, step, 0, pinned=False))
    assert here.rgb.shape == there.rgb.shape and here.rgb.dtype == there.rgb.dtype
    assert (here.rgb.float() - there.rgb.float()).abs().mean() < 1
    # Where a cell's middle is as near to two pixels, either may be taken.
    assert (here.ids != there.ids).float().mean() < 0.002


def test_a_batch_follows_from_seed_and_step(files: list[Path]) -> None:
    config = replace(CONFIG, crops=CropConfig(size_px=64))
    with DeviceViews(config, lambda: files, CPU, readers=1) as views:
        views.wait(GracefulStop())
        batches = device_batches(config, views, 0)
        first, second = next(batches), next(batches)
    # The order in which files are read does not matter.
    ready = files[::-1]
    with DeviceViews(config, lambda: ready, CPU, readers=1) as views:
        views.wait(GracefulStop())
        ready = files
        again = next(device_batches(config, views, 1))
    assert torch.equal(again.rgb, second.rgb) and torch.equal(again.ids, second.ids)
    assert not torch.equal(first.rgb, second.rgb)
    assert not torch.equal(first.rgb, batch_of(replace(config, seed=1), files).rgb)


def test_new_bins_are_used_when_they_have_been_read(files: list[Path]) -> None:
    known = files[:1]
    with DeviceViews(CONFIG, lambda: known, CPU, readers=1) as views:
        views.wait(GracefulStop())
        assert views.ready() == files[:1]
        known = files
        views.wait(GracefulStop())
        assert views.ready() == files


def test_a_damaged_file_stops_the_run(tmp_path: Path) -> None:
    (tmp_path / "bin.npz").write_bytes(b"not a bin")
    views = DeviceViews(CONFIG, lambda: [tmp_path / "bin.npz"], CPU, readers=1)
    with views, pytest.raises(DatasetError, match=r"bin\.npz is missing or damaged"):
        views.wait(GracefulStop())


def test_a_requested_stop_ends_the_reading(files: list[Path]) -> None:
    stop = GracefulStop()
    stop.requested = True
    with DeviceViews(CONFIG, lambda: files, CPU, readers=1) as views, pytest.raises(KeyboardInterrupt):
        views.wait(stop)


def test_views_that_exceed_the_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise torch.OutOfMemoryError("no memory")

    monkeypatch.setattr(device_views.torch, "empty", refuse)
    with pytest.raises(ConfigError, match=r"take 0\.0 GiB, which cpu does not have free; .* or with --crops loaders"):
        DeviceViews(CONFIG, list, CPU, readers=1)


@pytest.mark.parametrize(("free", "fits"), [(1.0, False), (2.0, True)])
def test_a_gpu_holds_the_views_if_they_take_60_percent_of_its_memory(
    monkeypatch: pytest.MonkeyPatch, free: float, fits: bool
) -> None:
    memory = int(free * views_bytes(CONFIG))
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (memory, 2 * memory))
    assert do_views_fit(CONFIG, torch.device("cuda")) == fits
