"""Kernels in files: damaged, unwritable, planted, shared by processes; a kernel that is compiled is always right."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from vibro_ros.solver import kernel_cache, numba_private
from vibro_ros.solver.kernel_cache import KernelFolder, cache_folder, progress


def twice(x):
    return 2.0 * x


def computed(folder: Path | None) -> tuple[float, str]:
    """What a new dispatcher of `twice` computes from 21, and whether it was compiled or loaded."""
    dispatcher = numba_private.stored(numba.njit(twice), KernelFolder(folder))
    before = len(progress.done), len(progress.loaded)
    answer = dispatcher(21.0)
    return answer, {(1, 0): "compiled", (0, 1): "loaded"}[len(progress.done) - before[0],
                                                          len(progress.loaded) - before[1]]


@pytest.fixture
def folder(tmp_path) -> Path:
    """The folder of kernels, not made yet."""
    return tmp_path / "deep" / "kernels"


def test_a_kernel_is_compiled_once(folder):
    assert computed(folder) == (42.0, "compiled")
    assert computed(folder) == (42.0, "loaded")
    assert progress.under_way == [] and progress.unwritable == ""
    (file,) = folder.iterdir()
    assert folder.stat().st_mode & 0o022 == file.stat().st_mode & 0o022 == 0


@pytest.mark.parametrize("damage", [
    lambda whole: b"",
    lambda whole: whole[:len(whole) // 2],
    lambda whole: whole[:-1] + bytes([whole[-1] ^ 1]),
], ids=["empty", "truncated", "flipped bit"])
def test_a_damaged_file_is_compiled_and_written_again(folder, damage):
    computed(folder)
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    assert computed(folder) == (42.0, "compiled")
    assert list(folder.iterdir()) == [file]
    assert computed(folder) == (42.0, "loaded")


def test_a_kernel_under_the_name_of_another_is_damaged(tmp_path):
    store = KernelFolder(tmp_path / "kernels")
    store.write("one.kernel", b"machine code")
    (tmp_path / "kernels" / "one.kernel").rename(tmp_path / "kernels" / "other.kernel")
    assert store.has("other.kernel") and store.read("other.kernel") is None


def give_away(path: Path, monkeypatch) -> None:
    """Let a path belong to another user: the superuser gives it away, anybody else is somebody else from now on."""
    if os.geteuid() == 0:
        os.chown(path, 65534, -1, follow_symlinks=False)
    else:
        monkeypatch.setattr(kernel_cache.os, "geteuid", lambda: 65534)


def linked(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


@pytest.mark.parametrize(("plant", "reason"), [
    (lambda folder, patch: give_away(folder, patch), "it belongs to another user"),
    (lambda folder, patch: folder.chmod(0o775), "other users can write it"),
    (lambda folder, patch: folder.chmod(0o707), "other users can write it"),
    (lambda folder, patch: linked(folder), "it is a link or no folder"),
], ids=["of another user", "group may write", "world may write", "link"])
def test_a_folder_that_others_can_write_is_neither_read_nor_written(folder, monkeypatch, plant, reason):
    computed(folder)
    before = {file: file.read_bytes() for file in folder.iterdir()}
    plant(folder, monkeypatch)
    assert computed(folder) == (42.0, "compiled")
    assert progress.unwritable == f"{folder}: {reason}"
    assert {file: file.read_bytes() for file in folder.iterdir()} == before


def test_the_folder_above_is_looked_at_where_it_holds_kernels_alone(tmp_path):
    above = tmp_path / "vibro_ros"
    assert KernelFolder(above / "kernels").make() == ""
    above.chmod(0o777)
    assert KernelFolder(above / "kernels").distrust() == f"{above}: other users can write it"


@pytest.mark.parametrize("plant", [
    lambda file, patch: file.chmod(0o666),
    lambda file, patch: linked(file),
    lambda file, patch: (file.unlink(), os.mkfifo(file)),
    lambda file, patch: give_away(file, patch),
], ids=["world may write", "link", "pipe", "of another user"])
def test_a_planted_file_is_not_run(folder, monkeypatch, plant):
    computed(folder)
    (file,) = folder.iterdir()
    plant(file, monkeypatch)
    assert computed(folder) == (42.0, "compiled")
    if os.geteuid() in (0, folder.stat().st_uid):  # else the folder is no longer ours either
        assert computed(folder) == (42.0, "loaded")  # the file has been replaced


def test_files_at_any_depth_are_looked_at_for_numbas_own_cache(tmp_path):
    store = KernelFolder(tmp_path / "kernels")
    assert store.make() == store.distrust_inside() == ""
    (tmp_path / "kernels" / "solver_1").mkdir(mode=0o755)
    planted = tmp_path / "kernels" / "solver_1" / "flow.nbi"
    planted.touch()
    planted.chmod(0o664)
    assert store.distrust_inside() == f"{planted}: other users can write it"


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert computed(tmp_path / "file" / "kernels") == (42.0, "compiled")
    assert progress.unwritable == f"{tmp_path / 'file' / 'kernels'}: Not a directory"
    assert computed(None) == (42.0, "compiled")
    assert progress.unwritable == "no home folder is known"


def test_a_full_disk_is_reported_and_nothing_is_left_behind(folder):
    computed(folder)  # so that the limit hits nothing else that the compiler writes
    (file,) = folder.iterdir()
    file.unlink()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        found = computed(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert found == (42.0, "compiled")
    assert progress.unwritable == f"{folder}: File too large"
    assert list(folder.iterdir()) == []


def test_folders_in_turn(monkeypatch, tmp_path):
    assert cache_folder(str(tmp_path)).parent == tmp_path
    assert cache_folder("").parent == Path(kernel_cache.__file__).with_name("__pycache__")
    monkeypatch.setattr(kernel_cache.os, "access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder("").parent == tmp_path / "cache" / "vibro_ros"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder("").parent == tmp_path / ".cache" / "vibro_ros"
    monkeypatch.setattr(kernel_cache.os.path, "expanduser", lambda path: path)  # a user whom no list knows
    assert cache_folder("") is None


PROGRAM = """
from vibro_ros.solver.compilation import entry_kernel

@entry_kernel
def twice(x):
    return 2.0 * x

print(twice(21.0))
"""


def test_processes_that_fill_the_cache_together(tmp_path, monkeypatch):
    (tmp_path / "program.py").write_text(PROGRAM)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    started = [subprocess.Popen([sys.executable, tmp_path / "program.py"], stdout=subprocess.PIPE, text=True)
               for _ in range(4)]
    assert [process.communicate(timeout=60)[0] for process in started] == ["42.0\n"] * 4
    (file,) = tmp_path.glob("kernels/*/*")
    assert file.suffix == ".kernel"
