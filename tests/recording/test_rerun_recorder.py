import signal
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from simpick.errors import ConfigError, OutputError, UnknownNameError
from simpick.geometry.transforms import transform_points
from simpick.recording import NullRecorder, Recorder, RerunRecorder, metrics_from_rrd, properties_from_rrd
from simpick.recording.legend import LEGEND
from tests.recording.commands import is_whole, record_in_process, rerun
from tests.recording.episode import CAMERA, T_WORLD_CAMERA, XML, record_episode, records
from tests.recording.reading import chunks, entities, series


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "episode.rrd"
    with RerunRecorder(path) as recorder:
        record_episode(recorder, timings_s={"render": 0.25})
    return path


def test_both_recorders_follow_the_protocol(tmp_path):
    with RerunRecorder(tmp_path / "a.rrd") as recorder:
        assert isinstance(recorder, Recorder)
    assert isinstance(NullRecorder(), Recorder)


def test_null_recorder_takes_a_whole_episode():
    with NullRecorder() as recorder:
        record_episode(recorder)


def test_protocol_and_null_recorder_do_not_load_rerun():
    code = "import sys, simpick.recording, simpick.recording.base; sys.exit('rerun' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_recording_passes_rerun_verify(recording):
    assert is_whole(recording)


def test_truncated_recording_fails_rerun_verify(recording, tmp_path):
    broken = tmp_path / "broken.rrd"
    broken.write_bytes(recording.read_bytes()[:-2000])
    assert not is_whole(broken)


def test_two_processes_write_equal_recordings(recording, tmp_path):
    path = tmp_path / "again.rrd"
    assert record_in_process(path) == 0
    compared = rerun("rrd", "compare", "--unordered", recording, path)
    assert compared.returncode == 0, compared.stderr


def test_recordings_with_timings_differ_from_those_without(recording, tmp_path):
    path = tmp_path / "timed.rrd"
    with RerunRecorder(path, record_timings=True) as recorder:
        record_episode(recorder, timings_s={"render": 0.25})
    assert rerun("rrd", "compare", "--unordered", recording, path).returncode != 0
    assert [record.timings_s for record in metrics_from_rrd(path)] == [{"render": 0.25}] * 3


def test_pick_table_read_back_equals_the_records(recording):
    assert metrics_from_rrd(recording) == records()


def test_configuration_and_summary_are_properties(recording):
    config = properties_from_rrd(recording)
    expected = {"seed": 7, "gripper": "jaw", "noise_mm": 0.5, "parts": '["block", "cube"]', "bin.depth_m": 0.12}
    assert config == expected
    assert properties_from_rrd(recording, "summary") == {"success_rate": 1 / 3, "modes": '["oracle"]'}


def test_recording_has_the_designed_entities_and_timelines(recording):
    found = entities(recording)
    assert {
        "/world/cameras/overhead/rgb",
        "/world/cameras/overhead/depth",
        "/world/cameras/overhead/detections",
        "/world/cameras/overhead/masks",
        "/world/cameras/overhead/detections/outlines",
        "/world/detections/overhead",
        "/world/estimates/oracle/block",
        "/world/estimates/oracle/edges",
        "/world/truth",
        "/legend",
        "/world/grasp",
        "/world/gripper\\/tip",
        "/world/part_00/visual",
        "/pose_error/rotation_deg",
        "/pick/outcome",
        "/gripper/contact_force_n",
        "/user/reward",
        "/log",
    } <= found
    timelines = {name for chunk in chunks(recording) for name in chunk.timeline_names}
    assert timelines == {"pick", "sim_time"}


def test_motion_is_noted_at_the_chosen_rate_and_bodies_at_rest_are_not(recording):
    times, _ = series(recording, "/world/gripper\\/tip", "Transform3D:translation")
    moving = np.diff(times)
    # The model steps 2 ms, so that 40 ms are met exactly.
    assert np.isclose(moving.min(), 0.04, atol=1e-6)
    rest, _ = series(recording, "/world/cameras/unused", "Transform3D:translation")
    assert len(rest) == 1


def test_contact_force_is_the_weight_that_the_gripper_rests_with(recording):
    _, newtons = series(recording, "/gripper/contact_force_n", "Scalars:scalars")
    model = mujoco.MjModel.from_xml_string(XML)
    weight = 9.81 * model.body("gripper/tip").mass[0]
    assert newtons[0][0] == pytest.approx(0, abs=1e-9) or newtons[0][0] < weight
    assert newtons[-1][0] == pytest.approx(weight, rel=0.05)


def test_detections_estimates_and_truth_have_colours_of_their_own_as_the_legend_says(recording):
    colours = {}
    for name, path in (
        ("orange", "/world/detections/overhead"),
        ("cyan", "/world/estimates/oracle/edges"),
        ("green", "/world/truth"),
    ):
        _, rows = series(recording, path, "LineStrips3D:colors")
        colours[name] = {int(rgba) for row in rows for rgba in row}
        assert name in LEGEND and "/".join(path.split("/")[1:3]) in LEGEND
    assert all(len(own) == 1 for own in colours.values())
    assert len(set.union(*colours.values())) == 3


def test_a_detection_s_outline_in_3d_lies_on_the_rays_of_its_pixels(recording):
    _, outlines = series(recording, "/world/detections/overhead", "LineStrips3D:strips")
    assert [len(row) for row in outlines] == [2, 1, 0]
    points = np.array(outlines[0][0])
    pixels = CAMERA.project(transform_points(np.linalg.inv(T_WORLD_CAMERA), points))
    np.testing.assert_allclose([pixels.min(axis=0), pixels.max(axis=0)], [[10.5, 10.5], [29.5, 19.5]], atol=1e-3)
    # The camera is 1.2 m high, and its image shows a depth of 1 m.
    np.testing.assert_allclose(points[:, 2], 0.2, atol=1e-6)


def test_truth_shows_the_parts_in_the_bin_only(recording):
    _, edges = series(recording, "/world/truth", "LineStrips3D:strips")
    assert [len(row) for row in edges] == [12] * 3  # Of one block.


def test_vanished_estimates_are_scaled_to_nothing(recording):
    _, scales = series(recording, "/world/estimates/oracle/block", "InstancePoses3D:scales")
    assert [len(row) for row in scales] == [2, 1, 1]
    assert np.all(np.array(scales[-1]) == 0)


@pytest.mark.parametrize(
    ("event", "code"), [("exit", 0), ("raise", 1), ("terminate", -signal.SIGTERM), ("interrupt", -signal.SIGINT)]
)
def test_recording_is_whole_however_the_process_ends(tmp_path, event, code):
    path = tmp_path / "episode.rrd"
    assert record_in_process(path, event) == code
    assert is_whole(path)
    assert metrics_from_rrd(path) == records()


def test_recording_of_a_broken_pick_holds_the_picks_before(tmp_path):
    path = tmp_path / "episode.rrd"
    with pytest.raises(ZeroDivisionError), RerunRecorder(path) as recorder:
        record_episode(recorder)
        recorder.start_pick(3)
        recorder.stage("approach")
        raise ZeroDivisionError
    assert is_whole(path)
    assert metrics_from_rrd(path) == records()


def test_sigterm_handling_is_given_back(tmp_path):
    with RerunRecorder(tmp_path / "a.rrd"):
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_recorder_without_an_episode_leaves_no_file(tmp_path):
    RerunRecorder(tmp_path / "a.rrd").close()
    assert list(tmp_path.iterdir()) == []


def test_closing_twice_is_harmless(recording, tmp_path):
    recorder = RerunRecorder(tmp_path / "a.rrd")
    record_episode(recorder)
    recorder.close()
    size = (tmp_path / "a.rrd").stat().st_size
    recorder.close()
    assert (tmp_path / "a.rrd").stat().st_size == size


def test_existing_recording_is_kept_without_overwrite(recording):
    before = recording.read_bytes()
    with pytest.raises(OutputError, match=r"it exists already; choose another name or delete it"):
        RerunRecorder(recording)
    RerunRecorder(recording, overwrite=True).close()
    assert recording.read_bytes() == before


def test_unwritable_folder_is_an_output_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot record to .*a\.rrd: .*; choose a folder that you may write to"):
        RerunRecorder(tmp_path / "file" / "a.rrd")


def test_wrong_suffix_and_values_are_config_errors(tmp_path):
    with pytest.raises(ConfigError, match=r"must end in \.rrd, got .*a\.mp4"):
        RerunRecorder(tmp_path / "a.mp4")
    with pytest.raises(ConfigError, match=r"rate_hz must be in \(0, 1000\], got 0"):
        RerunRecorder(tmp_path / "a.rrd", rate_hz=0)
    with pytest.raises(ConfigError, match=r"jpeg_quality must be in 1\.\.100, got 101"):
        RerunRecorder(tmp_path / "a.rrd", jpeg_quality=101)


def test_events_out_of_order_are_config_errors(tmp_path):
    with RerunRecorder(tmp_path / "a.rrd") as recorder:
        with pytest.raises(ConfigError, match="stage must come between start_episode and close"):
            recorder.stage("lift")
        record_episode(recorder)
        with pytest.raises(ConfigError, match="holds one episode; make another one"):
            record_episode(recorder)
        with pytest.raises(ConfigError, match="end_pick got the record of pick 9 in pick 2; start it first"):
            recorder.end_pick(replace(records()[0], pick=9))


def test_unknown_names_list_those_that_exist(tmp_path):
    with RerunRecorder(tmp_path / "a.rrd") as recorder:
        record_episode(recorder)
        with pytest.raises(UnknownNameError, match=r"no camera named 'side'. Valid: overhead, unused, wrist\."):
            recorder.detections("side", [])
        estimate = _estimate_of("gear")
        with pytest.raises(UnknownNameError, match=r"named 'gear'. Valid: block. Pass it to start_episode"):
            recorder.estimates(T_WORLD_CAMERA, [estimate])


def test_recording_switched_off_by_the_environment_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN", "off")
    with RerunRecorder(tmp_path / "a.rrd") as recorder, pytest.raises(ConfigError, match="environment variable RERUN"):
        record_episode(recorder)
    assert list(tmp_path.iterdir()) == []


def _estimate_of(part):
    from simpick.records import PoseEstimate

    return PoseEstimate(part, np.eye(4), 1.0, "oracle", 0.0)


def test_a_disk_that_fills_up_between_two_picks_is_reported_and_leaves_a_whole_recording(tmp_path):
    resource = pytest.importorskip("resource")
    path, model = tmp_path / "full.rrd", mujoco.MjModel.from_xml_string(XML)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with RerunRecorder(path) as recorder:
        recorder.start_episode(episode_id="full", config={}, model=model, data=mujoco.MjData(model), parts=[])
        recorder.start_pick(0)
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, before[1]))
            with pytest.raises(OutputError, match=r"cannot record to .*full\.rrd: File too large.*make room and run"):
                recorder.start_pick(1)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert is_whole(path) and [file.name for file in tmp_path.iterdir()] == ["full.rrd"]
