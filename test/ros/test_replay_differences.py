"""What a replay says of a recording in which a bit, a stamp, a message or a command is another."""

import pytest
from random_run import rewritten

from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings import replay

LAST_POSITION = -8 * (1 + 1 + 5 + 1 + 5)  # of joint_states: then lengths and numbers of velocity, effort


@pytest.mark.parametrize("bit", [0, 51, 63])
def test_one_flipped_bit_of_a_state_is_named(recorded, tmp_path, capsys, bit):
    chosen = []

    def flip(messages):
        number = [i for i, (topic, _, _) in enumerate(messages) if topic == "/joint_states"][333]
        topic, stamp, data = messages[number]
        changed = bytearray(data)
        changed[LAST_POSITION + bit // 8] ^= 1 << bit % 8
        chosen.append(stamp)
        return [*messages[:number], (topic, stamp, bytes(changed)), *messages[number + 1:]]

    assert replay.main([str(rewritten(recorded, tmp_path / "flipped", flip))]) == 1
    out = capsys.readouterr().out
    assert "different after " in out
    assert f"first difference: /joint_states message 333 at 1.665 s (stamp {chosen[0]}): " in out
    assert "position[4] (inclined_plate): recorded " in out
    assert (f"({2**bit} ulp)" in out) == (bit < 63)  # the last one is the sign


def test_a_spoilt_stamp_is_named_at_once(recorded, tmp_path, capsys):
    def spoil(messages):
        topic, stamp, data = messages[-1]
        return [*messages[:-1], (topic, stamp + 10**18, data)]  # 32 years later

    assert replay.main([str(rewritten(recorded, tmp_path / "spoilt", spoil))]) == 1
    assert "recorded stamp: recorded " in capsys.readouterr().out


def test_one_flipped_bit_in_the_file_is_caught(recorded, tmp_path, capsys):
    """MCAP's checksums find it before the comparison does: the chunk is named, and the rest compared."""
    folder = rewritten(recorded, tmp_path / "flipped")
    with BagStream(folder) as stream:
        data = [bytes(data) for _, _, data in stream.messages(frozenset({"/odom"}))][321]
    (file,) = folder.glob("flipped_0.*")
    content = bytearray(file.read_bytes())
    assert content.count(data) == 1
    content[content.index(data) + data.index(b"base_link") + 16] ^= 1  # in the position
    file.write_bytes(content)
    assert replay.main([str(folder)]) in (0, 1)  # 1 where the chunk had commands
    said = capsys.readouterr().out
    assert "\nnot read: flipped_0.mcap: " in said and "another checksum than it says" in said


@pytest.mark.parametrize("way", ["dropped", "untold"])
def test_a_message_that_lacks_is_told(recorded, tmp_path, capsys, way):
    def lose(messages):
        (lost,) = [i for i, (topic, _, _) in enumerate(messages) if topic == "/odom"][100:101]
        return messages[:lost] + messages[lost + 1:]

    folder = rewritten(recorded, tmp_path / "lossy", lose, dropped="1" if way == "dropped" else "0")
    assert replay.main([str(folder)]) == (0 if way == "dropped" else 1)
    out = capsys.readouterr().out
    if way == "dropped":
        assert "not recorded: 1 messages" in out
    else:
        assert "/odom message 100 at 0.5 s" in out and "recorded 'no message'" in out


@pytest.mark.parametrize("topic", ["/odom", "/impacts"])
def test_a_message_too_many_is_told(recorded, tmp_path, capsys, topic):
    def add(messages):
        twice = [i for i, (name, _, _) in enumerate(messages) if name == topic][10]
        return messages[:twice] + [messages[twice]] + messages[twice:]

    assert replay.main([str(rewritten(recorded, tmp_path / "more", add))]) == 1
    assert f"{topic} message 11 at " in capsys.readouterr().out


def test_a_lost_command_is_found(recorded, tmp_path, capsys):
    def lose(messages):
        first = [i for i, (topic, _, _) in enumerate(messages) if topic == "/motor_speed"][3]
        return messages[:first] + messages[first + 1:]

    assert replay.main([str(rewritten(recorded, tmp_path / "lossy", lose, dropped="1"))]) == 1
    assert "note: 1 messages dropped; a command may be among them" in capsys.readouterr().out
