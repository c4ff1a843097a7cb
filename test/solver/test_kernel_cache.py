"""Kernels in files: damaged, unwritable, shared by processes; a kernel that is compiled is always right."""

import resource
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from vibro_ros.solver import compilation
from vibro_ros.solver.kernel_cache import KernelCache
from vibro_ros.solver.progress import progress


def twice(x):
    return 2.0 * x


def computed(folder: Path | None) -> tuple[float, str]:
    """What a new dispatcher of `twice` computes from 21, and whether it was compiled or loaded."""
    dispatcher = numba.njit(twice)
    dispatcher._cache = KernelCache(twice, folder)
    before = len(progress.done), len(progress.loaded)
    answer = dispatcher(21.0)
    return answer, {(1, 0): "compiled", (0, 1): "loaded"}[len(progress.done) - before[0],
                                                          len(progress.loaded) - before[1]]


def test_a_kernel_is_compiled_once(tmp_path):
    assert computed(tmp_path / "deep" / "er") == (42.0, "compiled")
    assert computed(tmp_path / "deep" / "er") == (42.0, "loaded")
    assert progress.under_way == []


DAMAGE = {
    "empty": lambda whole: b"",
    "truncated": lambda whole: whole[:len(whole) // 2],
    "only the checksum": lambda whole: whole[:32],
    "flipped bit in the checksum": lambda whole: bytes([whole[0] ^ 1]) + whole[1:],
    "flipped bit in the middle": lambda whole: whole[:5000] + bytes([whole[5000] ^ 16]) + whole[5001:],
    "flipped bit at the end": lambda whole: whole[:-1] + bytes([whole[-1] ^ 1]),
    "appended": lambda whole: whole + b"\0",
    "of something else": lambda whole: b"hello, world" * 1000,
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_compiled_and_written_anew(tmp_path, damage):
    computed(tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert computed(tmp_path) == (42.0, "compiled")
    assert list(tmp_path.iterdir()) == [file]
    assert computed(tmp_path) == (42.0, "loaded")


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert computed(tmp_path / "file" / "kernels") == (42.0, "compiled")
    assert progress.unwritable == f"{tmp_path / 'file' / 'kernels'}: Not a directory"


def test_no_room_is_told_and_leaves_nothing_behind(tmp_path):
    computed(tmp_path)  # so that the limit hits nothing else that the compiler writes
    (file,) = tmp_path.iterdir()
    file.unlink()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        found = computed(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert found == (42.0, "compiled")
    assert progress.unwritable == f"{tmp_path}: File too large"
    assert list(tmp_path.iterdir()) == []


def test_without_a_home_nothing_is_kept_and_that_is_told():
    assert computed(None) == (42.0, "compiled")
    assert progress.unwritable == "no home folder is known"


def test_folders_in_turn(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert compilation.cache_folder().parent == tmp_path
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    assert compilation.cache_folder().parent == Path(compilation.__file__).with_name("__pycache__")
    monkeypatch.setattr(compilation.os, "access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert compilation.cache_folder().parent == tmp_path / "cache" / "vibro_ros"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert compilation.cache_folder().parent == tmp_path / ".cache" / "vibro_ros"
    monkeypatch.setattr(compilation.os.path, "expanduser", lambda path: path)  # a user whom no list knows
    assert compilation.cache_folder() is None


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
