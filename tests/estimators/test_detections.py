"""Detections by name: the simulator's, the shipped detector's, and those of other packages."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest

from simpick.errors import PluginError, UnknownNameError
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


def test_an_unknown_name_lists_what_exists() -> None:
    with pytest.raises(UnknownNameError, match=r"no detections named 'perfekt'\. Valid: .*Did you mean 'perfect'"):
        make("perfekt")
