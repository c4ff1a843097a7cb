"""The executable: files beside the recording, one-line errors, exit codes."""

import json
import shutil
import warnings

import numpy as np
import pytest
from matplotlib.image import imread
from robot_bag import edit_each, rewritten
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import vibro_ros.recordings.recover as recover_executable
import vibro_ros.recordings.replay as replay
import vibro_ros.recordings.report as report
from vibro_ros.bag.reader import BagError, load_bag, read_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.recordings.energy import energy_of
from vibro_ros.recordings.summary import as_text, load_samples, summarise


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_report_is_written_beside_the_recording_which_stays_untouched(record_run, capsys):
    folder = record_run()
    content_before = contents(folder)
    assert report.main([str(folder)]) == 0
    assert contents(folder) == content_before
    output = folder.with_name("run_report")
    assert sorted(path.name for path in output.iterdir()) == ["report.png", "summary.json", "summary.txt"]
    summary = summarise(read_bag(folder)) | {"energy": energy_of(read_bag(folder))}
    assert json.loads((output / "summary.json").read_text(encoding="utf-8")) == summary
    assert (output / "summary.txt").read_text(encoding="utf-8") == as_text(summary)
    printed = capsys.readouterr().out
    assert as_text(summary) in printed
    assert str(output / "report.png") in printed
    pixels = imread(output / "report.png")
    assert min(pixels.shape[:2]) >= 1000 and 0.02 < (pixels[..., :3].min(axis=2) < 0.9).mean() < 0.5
    for _ in range(2):
        assert report.main([str(folder), "--output", str(folder.parent / "deep" / "er")]) == 0
    assert len(list((folder.parent / "deep" / "er").iterdir())) == 3


def test_joints_of_another_robot_on_the_topic_do_not_change_a_report(record_run, tmp_path):
    """They come first, and again and again between the robot's own messages."""
    wheel = new_message("sensor_msgs/msg/JointState")
    wheel.name, wheel.position = ["wheel"], np.array([1.0])
    data = serialised(wheel, "sensor_msgs/msg/JointState")
    run = record_run()
    mixed = rewritten(run, tmp_path / "mixed", lambda messages: sorted(
        [*messages, *(("/joint_states", stamp - (not k), data) for k, (_, stamp, _) in enumerate(messages[::50]))],
        key=lambda message: message[1]))
    whole, summary_of_mixed = (summarise(load_samples(folder)) for folder in (run, mixed))
    for key in ("displacement", "crank_turns", "impacts", "mean_power", "validity"):
        assert summary_of_mixed[key] == whole[key], key
    assert report.main([str(mixed)]) == 0


def test_a_recording_is_neither_trusted_nor_written_into(record_run, tmp_path, capsys):
    hostile = rewritten(record_run(), tmp_path / "hostile", parameters='["\x1b[2J' + "x" * 10_000)
    content_before = contents(hostile)
    assert report.main([str(hostile), "--output", str(hostile / "inside")]) == 2
    assert "lies inside the recording" in one_error_line(capsys)
    assert report.main([str(hostile)]) == 0
    printed = capsys.readouterr().out
    assert contents(hostile) == content_before and "\x1b" not in printed and max(map(len, printed.splitlines())) < 400


def one_error_line(capsys):
    captured = capsys.readouterr()
    assert captured.out == ""
    [line] = captured.err.splitlines()
    assert line.startswith("report: ")
    return line


@pytest.mark.parametrize("make, reason", [
    (lambda folder: shutil.rmtree(folder), "run: no such folder; give the folder of a recording"),
    (lambda folder: folder.with_name("run_report").write_text(""),
     "run_report: cannot write: File exists; give a writable --output"),
], ids=["missing", "output"])
def test_a_recording_that_cannot_be_reported_gives_exit_code_2(record_run, capsys, make, reason):
    folder = record_run()
    make(folder)
    assert report.main([str(folder)]) == 2
    assert reason in one_error_line(capsys)


def foreign(folder, target, plugin=StoragePlugin.MCAP, mode=None):
    """Return the same messages as another program records them: without custom data, or of an earlier version, with a
    topic of its own.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    unopened = Writer(target, version=8, storage_plugin=plugin)
    if mode:
        unopened.set_compression(mode, CompressionFormat.ZSTD)
    with BagStream(folder) as stream, unopened as writer:
        connections = {topic: writer.add_connection(topic, information.type_name, typestore=store)
                       for topic, information in stream.topics.items()}
        extra = writer.add_connection("/rosout_text", "std_msgs/msg/String", typestore=store)
        text = store.serialize_cdr(store.types["std_msgs/msg/String"](data="hello"), "std_msgs/msg/String")
        writer.write(extra, stream.start, text)
        for topic, stamp, data in stream.messages():
            writer.write(connections[topic], stamp, bytes(data))


@pytest.mark.parametrize("mode", [None, CompressionMode.STORAGE], ids=["plain", "compressed chunks"])
def test_a_bag_of_another_program_gives_the_same_numbers(record_run, tmp_path, mode):
    folder = record_run()
    foreign(folder, tmp_path / "other", mode=mode)
    report.write_report(tmp_path / "other")
    summary_of_run, other = (summarise(load_bag(path)) for path in (folder, tmp_path / "other"))
    for summary in (summary_of_run, other):
        del summary["bag"], summary["recorder"], summary["not_read"]
        summary["topics"].pop("/rosout_text", None)
    assert other == summary_of_run


@pytest.mark.parametrize("plugin, mode, remedy", [
    (StoragePlugin.SQLITE3, None, "run.db3: is of the storage sqlite3; `ros2 bag convert` makes an MCAP bag of it"),
    (StoragePlugin.MCAP, CompressionMode.FILE, "run.mcap.zstd: is compressed as a whole; `zstd -d` unfolds it"),
], ids=["sqlite3", "file"])
def test_other_storages_are_refused_with_the_remedy(record_run, tmp_path, capsys, plugin, mode, remedy):
    foreign(record_run(), tmp_path / "other" / "run", plugin, mode)
    folder = tmp_path / "other" / "run"
    content_before = contents(folder)
    for main in (report.main, replay.main, recover_executable.main):
        assert main([str(folder)]) == 2
        said = capsys.readouterr()
        assert said.out == "" and said.err.count("\n") == 1 and remedy.partition(": ")[2][:20] in said.err
    with pytest.raises(BagError, match=remedy.partition(";")[2]):
        read_bag(folder)
    assert contents(folder) == content_before


@pytest.mark.parametrize("topic, at, value", [("motor_power", -8, 1e308), ("joint_states", 100, np.nan)])
def test_numbers_that_no_robot_sends_are_left_out_and_named(record_run, tmp_path, capsys, topic, at, value):
    def spoilt(message):
        name, stamp, data = message
        if name == f"/{topic}" and stamp % 3 == 0:
            data = bytearray(data)
            data[at:at + 8 or None] = np.float64(value).tobytes()
        return name, stamp, bytes(data)

    rewritten(record_run(count=200), tmp_path / "spoilt", edit_each(spoilt))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert report.main([str(tmp_path / "spoilt")]) == 0
    said = capsys.readouterr()
    assert said.err == "" and "nan" not in said.out
    summary = json.loads((tmp_path / "spoilt_report" / "summary.json").read_text(), parse_constant=pytest.fail)
    if topic == "motor_power":
        (flaw,) = summary["not_read"]
        assert flaw.startswith(f"/{topic}: ") and flaw.endswith("numbers that are not finite, or beyond 1e+100")
