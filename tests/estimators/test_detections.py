"""Detections by name: the simulator's, the shipped detector's, and those of other packages."""

from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from simpick.errors import ConfigError, DatasetError, PluginError, UnknownNameError
from simpick.estimators import detections, plugins
from simpick.estimators.detections import detector_data, detector_names, is_simulated, make_detector
from simpick.estimators.segmentation_detector import SegmentationDetector


class Blind:
    """Detects nothing."""

    def detect(self, frame, parts):
        return []


@pytest.fixture
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        EntryPoint("blind", "tests.estimators.test_detections:Blind", detections.ENTRY_POINT_GROUP),
        EntryPoint("gone", "no_such_package:Detector", detections.ENTRY_POINT_GROUP),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: [e for e in entries if e.group == group])


def make(name: str):
    return make_detector(name, ["hex_nut"], np.random.default_rng(0))


@pytest.mark.parametrize("name", ["perfect", "realistic", "box"])
def test_simulated_detections_come_from_the_simulator(name: str) -> None:
    assert is_simulated(name) and detector_data(name) == {}
    assert isinstance(make(name), SegmentationDetector)


@pytest.mark.usefixtures("_registered")
def test_detectors_of_other_packages_have_names() -> None:
    assert {"perfect", "learned", "blind", "gone"} <= set(detector_names())
    assert isinstance(make("blind"), Blind) and not is_simulated("blind")


@pytest.mark.usefixtures("_registered")
def test_a_package_that_cannot_be_imported_is_named() -> None:
    with pytest.raises(PluginError, match=r"'gone', .* simpick.detectors = no_such_package:Detector, cannot be made"):
        make("gone")


def test_a_file_is_refused_where_images_are_new() -> None:
    with pytest.raises(ConfigError, match=r"got the file 'found\.json'.*Take learned, or register your detector"):
        make("found.json")


def test_results_depend_on_the_content_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "found.json"
    file.write_text("[]")
    before = detector_data(str(file))
    file.write_text("[ ]")
    assert list(before) == ["found.json"] and detector_data(str(file)) != before
    with pytest.raises(DatasetError, match=r"no file .*gone\.json\. Give a detections file in BOP's format"):
        detector_data(str(tmp_path / "gone.json"))


def test_an_unknown_name_lists_what_exists() -> None:
    with pytest.raises(UnknownNameError, match=r"no detections named 'perfekt'\. Valid: .*Did you mean 'perfect'"):
        make("perfekt")
