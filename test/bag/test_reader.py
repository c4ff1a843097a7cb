"""Reading recordings back as arrays."""

import os
import subprocess
import sys

import numpy as np
import pytest
from recorded_bag import content, mcap_file
from rosbags.typesys import Stores, get_typestore

import vibro_ros
from vibro_ros.bag.reader import BagError, BagWarning, MissingTopicError, read_bag
from vibro_ros.bag.recorder import Recorder, Topic
from vibro_ros.messages.codec import new_message, serialised

TYPES = {"odom": "nav_msgs/msg/Odometry", "joint_states": "sensor_msgs/msg/JointState",
         "impacts": "geometry_msgs/msg/WrenchStamped", "motor_power": "std_msgs/msg/Float64"}
N = 50


def topics(namespace=""):
    return [Topic(f"{namespace}/{name}", type_name, 10) for name, type_name in TYPES.items()]


def write_run(recorder, published, start_ns, namespace="", count=N):
    for i in range(count):
        for topic, message in published.items():
            recorder.write(namespace + topic, start_ns + i * 1_000_000, message(i))


@pytest.fixture
def run(folder, published, start_ns):
    """Return the folder of a recorded run."""
    with Recorder(folder, topics(), {"scene": "device"}) as recorder:
        write_run(recorder, published, start_ns)
    return folder


@pytest.fixture
def bag(run):
    return read_bag(run)


def test_times_are_recorded_stamps_from_the_first_message(bag, start_ns):
    assert {name: (topic.type_name, topic.messages) for name, topic in bag.topics.items()} == {
        f"/{name}": (type_name, N) for name, type_name in TYPES.items()}
    assert bag.metadata == {"scene": "device", "written": str(4 * N), "dropped": "0", "lost": "0"}
    assert bag.start_ns == start_ns
    assert bag.duration == pytest.approx(0.049, abs=1e-15)
    for name in TYPES:  # 1e-15 s: the subtraction is done in integers
        np.testing.assert_allclose(bag[name]["time"], 1e-3 * np.arange(N), rtol=0, atol=1e-15)


def test_columns_are_the_messages_numbers(bag):
    odom, joints, impacts, i = bag["odom"], bag["joint_states"], bag["impacts"], np.arange(N)
    zero = 0.0 * i
    np.testing.assert_array_equal(odom["position"], np.column_stack([0.1 * i, zero, zero]))
    np.testing.assert_array_equal(odom["orientation"], np.column_stack([zero, zero, zero, zero + 1.0]))
    np.testing.assert_array_equal(odom["linear_velocity"], np.column_stack([-0.5 * i, zero, zero]))
    np.testing.assert_array_equal(odom["angular_velocity"], np.column_stack([zero, zero, 2.0 * i]))
    np.testing.assert_array_equal(joints["crank.position"], 0.1 * i)
    np.testing.assert_array_equal(joints["upper_mass.velocity"], -1.0 * i)
    np.testing.assert_array_equal(impacts["force"][:, 2], 900.0 + i)
    np.testing.assert_array_equal(impacts["torque"][:, 1], np.full(N, 0.5))
    assert list(impacts["frame"]) == ["upper_plate", "inclined_plate"] * (N // 2)
    np.testing.assert_array_equal(bag["motor_power"]["value"], 0.25 * i)
    np.testing.assert_allclose(impacts["stamp"], 1e-3 * i - 1e-9, rtol=0, atol=1e-15)  # to the nanosecond


def transforms(stamp, children):
    """Return a message of tf2_msgs, made by rosbags, with a transform for each child."""
    store = get_typestore(Stores.ROS2_JAZZY)
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items() if name.startswith(
        ("tf2_msgs", "geometry_msgs", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))}
    header = make["Header"](stamp=make["Time"](*divmod(stamp, 10**9)), frame_id="odom")
    return bytes(store.serialize_cdr(make["TFMessage"]([make["TransformStamped"](
        header, child, make["Transform"](make["Vector3"](0.5, 0.0, float(i)), make["Quaternion"](0.0, 0.0, 0.6, 0.8)))
        for i, child in enumerate(children)]), "tf2_msgs/msg/TFMessage"))


@pytest.fixture
def mixed(tmp_path, published, start_ns):
    """Return a bag with samples, two messages of transforms, one of which has too long a frame name, and an operation.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    reset = bytes(store.serialize_cdr(store.types["std_msgs/msg/String"](data="reset"), "std_msgs/msg/String"))
    with Recorder(tmp_path / "run", [*topics(), Topic("/tf", "tf2_msgs/msg/TFMessage", 10),
                                     Topic("/vibro_robot/operations", "std_msgs/msg/String", 10)], {}) as recorder:
        write_run(recorder, published, start_ns, count=3)
        recorder.write("/tf", start_ns + 2, transforms(start_ns, ["base_link", "crank"]))
        recorder.write("/tf", start_ns + 3, transforms(start_ns, ["base_link", "m" * 1001]))
        recorder.write("/vibro_robot/operations", start_ns + 4, reset)
    with pytest.warns(BagWarning, match="/tf: 1 unreadable message, .* its frame has more than 1000 characters"):
        return read_bag(tmp_path / "run")


def test_transforms_are_a_row_each_and_operations_texts(mixed):
    tf, operations = mixed["tf"], mixed["operations"]
    np.testing.assert_allclose(tf["time"], [2e-9, 2e-9], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(tf["stamp"], [0.0, 0.0])
    assert (list(tf["frame"]), list(tf["child"])) == (["odom"] * 2, ["base_link", "crank"])
    np.testing.assert_array_equal(tf["translation"], [[0.5, 0.0, 0.0], [0.5, 0.0, 1.0]])
    np.testing.assert_array_equal(tf["rotation"], [[0.0, 0.0, 0.6, 0.8]] * 2)
    assert list(operations["text"]) == ["reset"]


def test_every_topic_is_a_table_of_pandas(mixed):
    pandas = pytest.importorskip("pandas")
    tables = mixed.to_pandas()
    assert list(tables) == list(mixed)
    odom = tables["odom"]
    assert odom is tables["/odom"] and isinstance(odom, pandas.DataFrame) and odom.index.name == "time"
    assert list(odom)[:5] == ["stamp", "position.x", "position.y", "position.z", "orientation.x"]
    assert list(tables["tf"])[-4:] == [f"rotation.{axis}" for axis in "xyzw"]
    for topic, arrays in mixed.items():
        for name, array in arrays.items():
            of_table = tables[topic].reset_index()
            columns = of_table[[column for column in of_table
                                if column == name or array.ndim == 2 and column.startswith(f"{name}.")]]
            np.testing.assert_array_equal(columns.to_numpy().reshape(array.shape), array)


def test_an_array_is_found_by_the_name_of_its_column(mixed):
    odom = mixed["odom"]
    for axis, column in zip("xyzw", odom["orientation"].T, strict=True):
        np.testing.assert_array_equal(odom[f"orientation.{axis}"], column)
    for wrong in ("x", "position.w", "orientation.", "value"):
        with pytest.raises(KeyError, match=rf"^{wrong}: the topic has no such array; give one of time, stamp, "
                                           r"position\.x … position\.z, orientation\.x … orientation\.w, "):
            odom[wrong]
        assert wrong not in odom and odom.get(wrong) is None
    assert repr(mixed).startswith(f"<Bag {mixed.path}: ") and "/odom (" in repr(mixed) and "\n" not in repr(mixed)


def test_without_pandas_the_error_names_the_remedy(mixed, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"^to_pandas needs pandas \([^\n]*\): pip install pandas$"):
        mixed.to_pandas()


def test_empty_topics_give_empty_arrays_of_the_same_shape(tmp_path):
    Recorder(tmp_path / "run", topics(), {}).close()
    bag = read_bag(tmp_path / "run")
    assert (bag.start_ns, bag.duration) == (0, 0.0)
    assert bag["odom"]["position"].shape == (0, 3)
    assert bag["impacts"]["frame"].shape == (0,)
    assert list(bag["joint_states"]) == ["time", "stamp"]


def test_joints_of_several_publishers_have_instants_of_their_own(tmp_path, start_ns):
    """Some joints a message, in another order, another robot's first, and messages that lack a quantity."""
    def message(**joints):
        made = new_message(TYPES["joint_states"])
        made.name = list(joints)
        made.position, made.velocity = ([numbers[k] for numbers in joints.values() if k < len(numbers)] for k in (0, 1))
        return serialised(made, TYPES["joint_states"])

    rows = [message(wheel=[9.0]), message(a=[0.1], b=[0.2]), message(b=[1.2, 1.3], a=[1.1, 1.4]), message(c=[2.3]),
            message(b=[3.2])]
    with Recorder(tmp_path / "run", topics(), {}) as recorder:
        for i in (0, 2, 1, 3, 4):  # recorded out of order as well
            recorder.write("/joint_states", start_ns + i * 1_000_000, rows[i])
    bag = read_bag(tmp_path / "run")
    joints = bag["joint_states"]
    assert bag.flaws == () and len(joints["time"]) == 5
    for joint, at, positions in (("wheel", [0], [9.0]), ("a", [1, 2], [0.1, 1.1]), ("b", [1, 2, 4], [0.2, 1.2, 3.2]),
                                 ("c", [3], [2.3])):
        np.testing.assert_array_equal(joints[f"{joint}.position"], positions)
        np.testing.assert_allclose(joints[f"{joint}.time"], 1e-3 * np.array(at), rtol=0, atol=1e-15)
        assert joints[f"{joint}.stamp"].shape == (len(at),)
    np.testing.assert_array_equal(joints["b.velocity"], [np.nan, 1.3, np.nan])
    assert "wheel.velocity" not in joints
    pytest.importorskip("pandas")
    table = bag.to_pandas()["joint_states"]
    np.testing.assert_array_equal(table["b.position"].dropna(), [0.2, 1.2, 3.2])
    assert table["c.position"].dropna().index.tolist() == [pytest.approx(3e-3)]


def test_two_robots_in_a_bag_must_be_told_apart(tmp_path, published, start_ns):
    with Recorder(tmp_path / "run", topics("/a") + topics("/b"), {}) as recorder:
        write_run(recorder, published, start_ns, "/a", 2)
        write_run(recorder, published, start_ns, "/b", 3)
    bag = read_bag(tmp_path / "run")
    with pytest.raises(MissingTopicError, match="odom is ambiguous; give one of /a/odom, /b/odom"):
        bag["odom"]
    assert (len(bag["/a/odom"]["time"]), len(bag["/b/odom"]["time"])) == (2, 3)
    assert bag["b/odom"] is bag["/b/odom"]


def test_topic_of_the_same_name_and_another_type_is_not_taken(tmp_path):
    Recorder(tmp_path / "run", [Topic("/odom", "std_msgs/msg/Float64", 1), Topic("/text", "std_msgs/msg/String", 1)],
             {}).close()
    bag = read_bag(tmp_path / "run")
    assert "odom" not in bag
    with pytest.raises(MissingTopicError, match=r"topic odom is missing; recorded topics: /odom \(std_msgs"):
        bag["odom"]


def test_a_bag_that_is_not_sealed_is_read_at_once_and_left_as_it_is(unsealed):
    folder, sent = unsealed()
    with mcap_file(folder).open("ab") as file:
        file.write(b"torn")
    content_before = content(folder)
    with pytest.warns(BagWarning, match="it is not sealed, because its recorder still runs or was killed; its last 4 "
                      "bytes are torn and not read; `recover` seals it for other programs"):
        bag = read_bag(folder)
    np.testing.assert_array_equal(bag["motor_power"]["value"], np.arange(len(sent)) * 0.25)
    assert bag.metadata == {"scene": "device"} and content(folder) == content_before


@pytest.mark.parametrize(("how", "reason"), [
    (lambda folder: next(folder.glob("*.mcap")).unlink(),
     "nothing in it can be read: run_0.mcap: metadata.yaml names this file, and it is not in the folder"),
    (lambda folder: os.truncate(next(folder.glob("*.mcap")), 2000),
     "nothing in it can be read: run_0.mcap: it is not sealed"),
], ids=["no file", "cut"])
def test_an_unreadable_bag_is_an_error_of_one_line(run, how, reason):
    how(run)
    with pytest.raises(BagError) as raised:
        read_bag(run)
    assert str(raised.value).startswith(f"{run}: ")
    assert reason in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("topic, data", [
    ("/odom", b""), ("/joint_states", b"\0\1\0\0"), ("/impacts", b"\xff" * 12), ("/motor_power", b"\0\1\0\0\0"),
    ("/motor_power", b"\0\7\0\0" + bytes(8)), ("/motor_power", b"\0\1\0\0" + bytes(16)),
], ids=["no byte", "no data", "ones", "five bytes", "XCDR2", "too long"])
def test_an_unreadable_message_is_named_and_the_rest_is_read(tmp_path, published, start_ns, topic, data):
    with Recorder(tmp_path / "run", topics(), {}) as recorder:
        for i in range(6):
            recorder.write(topic, start_ns + i, data if i in (2, 4) else published[topic](i))
    with pytest.warns(BagWarning, match=rf"^.*run: not all of it is read: {topic}: 2 unreadable messages, the first is "
                      rf"number 2 at {start_ns + 2} ns: {len(data)} bytes are no [^\n]*$") as told:
        bag = read_bag(tmp_path / "run")
    assert len(told) == 1 and len(bag.flaws) == 1
    np.testing.assert_allclose(bag[topic]["time"], [0.0, 1e-9, 3e-9, 5e-9])
    assert {len(column) for column in bag[topic].values()} == {4}
    assert bag.topics[topic].messages == 6


def test_only_chosen_columns_are_read(run, bag):
    chosen = read_bag(run, {"odom": ["position"], "joint_states": ["*.position"], "motor_power": []})
    names = {topic: set(arrays) for topic, arrays in chosen.items()}
    assert names == {"/odom": {"time", "position"}, "/motor_power": {"time"},
                     "/joint_states": {"time", "crank.position", "upper_mass.position"}}
    for topic, arrays in chosen.items():
        for name, column in arrays.items():
            np.testing.assert_array_equal(column, bag[topic][name])
    assert chosen.topics == bag.topics


def test_read_bag_needs_neither_ros_nor_kernels(run):
    program = ("import sys, vibro_ros; bag = vibro_ros.read_bag(sys.argv[1]); print(len(bag['odom']['time'])); "
               "assert not {'rclpy', 'vibro_ros.solver.core'} & set(sys.modules)")
    done = subprocess.run([sys.executable, "-c", program, str(run)], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{N}\n", "")
    assert "[rad/s]" in vibro_ros.read_bag.__doc__
