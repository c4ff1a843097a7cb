"""`recover` of torn and damaged bags: what is whole is sealed, what is cut is kept, and no failure adds damage."""

import errno
import os
import resource
from pathlib import Path

import pytest
from recorded_bag import POWER, by_mcap, by_rosbags, content, torn

from vibro_ros.bag.recorder import Recorder
from vibro_ros.bag.recovery import RecoveryError, recover
from vibro_ros.recordings import recover as executable


@pytest.mark.parametrize("cut", range(1, 1500, 137))
def test_any_torn_tail_is_cut_and_told(unsealed, cut):
    """The file ends anywhere within its last records: each kind of record is torn in one of the cases."""
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    size = path.stat().st_size - cut
    os.truncate(path, size)
    done = recover(folder)
    found = by_rosbags(folder)
    assert found == by_mcap(folder) == sent[:len(found)]
    assert len(found) == done.messages
    assert done.messages in (60, 31, 0)  # a chunk is whole, or gone
    assert recover(folder).was_sealed


@pytest.mark.parametrize("tail", [b"\0" * 5000, b"\x06", os.urandom(500), b"\x06" + (2**63).to_bytes(8, "little")],
                         ids=["zeros", "half a head", "noise", "endless record"])
def test_rubbish_at_the_end_is_cut(unsealed, tail):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    with path.open("ab") as file:
        file.write(tail)
    done = recover(folder)
    assert done.cut == len(tail)
    assert by_rosbags(folder) == by_mcap(folder) == sent
    assert torn(folder) == {"run_0.mcap.torn": tail} and done.kept == (folder / "run_0.mcap.torn",)


def test_what_is_cut_is_kept_under_a_free_name_or_not_at_all(unsealed, capsys):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    for i, name in enumerate(("run_0.mcap.torn", "run_0.mcap.torn.2", "run_0.mcap.torn.3")):
        size = path.stat().st_size
        (folder / "metadata.yaml").unlink(missing_ok=True)
        path.write_bytes(path.read_bytes()[:size - 50] if i else path.read_bytes() + b"tail")
        assert executable.main([str(folder)]) == 0
        assert f"torn bytes cut, kept in {name}\n" in capsys.readouterr().out
        assert list(torn(folder))[-1] == name
    with path.open("ab") as file:
        file.write(b"tail")
    before = torn(folder)
    assert executable.main(["--discard-torn", str(folder)]) == 0
    assert "torn bytes cut\n" in capsys.readouterr().out
    assert torn(folder) == before and by_rosbags(folder) == sent


@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.EMFILE, "Too many open files"), KeyboardInterrupt()])
@pytest.mark.parametrize("where", ["mcap_scan.chunk_content", "recovery.write_all", "recovery._keep_tail"])
def test_what_goes_wrong_meanwhile_is_no_damage(unsealed, monkeypatch, error, where):
    """Nothing is cut because memory, the disk or the user's patience came to an end."""
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    with path.open("ab") as file:
        file.write(b"torn")
    before = content(folder)

    def fail(*_):
        raise error
    with monkeypatch.context() as patch:
        patch.setattr(f"vibro_ros.bag.{where}", fail)
        with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else RecoveryError):
            recover(folder)
    assert content(folder) == before
    recover(folder)
    assert by_rosbags(folder) == sent


def edit(folder: Path, old: str, new: str) -> None:
    text = (folder / "metadata.yaml").read_text()
    assert old in text
    (folder / "metadata.yaml").write_text(text.replace(old, new))


def flip(folder: Path) -> None:
    (path,) = folder.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[data.index((30).to_bytes(2, "little") * 6)] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("spoil, messages", [
    (lambda folder: edit(folder, "- run_0.mcap", "- ../../etc/passwd"), 40),
    (lambda folder: edit(folder, "- run_0.mcap", "- run_0.mcap\n  - run_0.mcap"), 40),
    (lambda folder: edit(folder, "version: 9", "version: 99"), 40),
    (lambda folder: edit(folder, "message_count: 40", "message_count: 41"), 40),
    (flip, 20),
], ids=["another name", "twice", "version", "count", "flipped bit"])
def test_sealed_is_said_of_what_every_reader_reads(tmp_path, published, wait_for, spoil, messages):
    folder = tmp_path / "run"
    with Recorder(folder, POWER, {}) as recorder:
        for i in range(40):
            recorder.write("/motor_power", i, i.to_bytes(2, "little") * 6)
            wait_for(lambda i=i: i != 19 or recorder.written == 20)
    spoil(folder)
    done = recover(folder)
    assert not done.was_sealed
    assert len(by_rosbags(folder)) == done.messages == messages
    assert recover(folder).was_sealed


def test_a_bag_of_which_nothing_can_be_read_is_left_as_it_is(tmp_path, published):
    folder = tmp_path / "run"
    with Recorder(folder, POWER, {}) as recorder:
        recorder.write("/motor_power", 1, (30).to_bytes(2, "little") * 6)
    flip(folder)
    before = content(folder)
    with pytest.raises(RecoveryError, match="nothing in it can be read: run_0.mcap: .* another checksum than it says"):
        recover(folder)
    assert content(folder) == before


def test_a_damaged_chunk_in_the_middle_costs_no_other(unsealed):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[data.index(sent[0][2])] ^= 1
    path.write_bytes(data)
    done = recover(folder)
    assert done.cut > 31 * 30  # bytes of the first chunk
    assert by_rosbags(folder) == by_mcap(folder) == sent[31:]
    assert done.messages == 29


@pytest.mark.parametrize("part", [0.2, 0.5, 0.9])
def test_a_recovery_that_was_killed_is_made_up_for(unsealed, part):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    before = path.stat().st_size
    recover(folder)
    (folder / "metadata.yaml").unlink()
    os.truncate(path, before + int(part * (path.stat().st_size - before)))
    recover(folder)
    assert by_rosbags(folder) == by_mcap(folder) == sent


def test_a_recovery_without_room_leaves_all_that_was_there(unsealed):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 100, hard))
    try:
        before = path.read_bytes()
        with pytest.raises(RecoveryError, match="cannot be sealed: File too large; nothing readable was lost"):
            recover(folder)
        assert path.read_bytes() == before
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    recover(folder)
    assert by_rosbags(folder) == sent


def test_an_empty_last_file_is_left_out(unsealed):
    folder, sent = unsealed()
    (folder / "run_1.mcap").write_bytes(b"")
    assert recover(folder).messages == 60
    assert by_rosbags(folder) == sent
    assert recover(folder).was_sealed
