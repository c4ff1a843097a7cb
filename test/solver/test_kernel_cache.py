"""The folder of compiled kernels: its place, its owner, damage, a full disk, several first starts at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from vibro_ros.solver import kernel_cache
from vibro_ros.solver.kernel_cache import KernelStore

PROGRAM = """
import resource, sys
from vibro_ros.solver.compilation import compile_entry, entry, progress

@entry
def twice(x):
    return 2.0 * x

if len(sys.argv) > 1:
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
compile_entry(twice, (1.0,))
print(twice(21.0), *progress.done, *("loaded" for _ in progress.loaded), progress.unwritable)
"""


@pytest.fixture
def computed(tmp_path, monkeypatch):
    """Return what a new process computes from 21, whether it compiled or loaded, and what it reports of the folder."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "chosen"))

    def run(*arguments: str) -> str:
        done = subprocess.run([sys.executable, program, *arguments], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()
    return run


def kernels(folder: Path) -> list[Path]:
    """Return the files of the cache in a folder."""
    return sorted(file for file in folder.rglob("*.nb?") if file.is_file())


def test_a_kernel_is_compiled_once(computed, tmp_path):
    assert computed() == "42.0 twice"
    assert computed() == "42.0 loaded"
    assert len(kernels(tmp_path / "chosen")) == 2


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [lambda whole: b"", lambda whole: whole[:len(whole) // 2]], ids=["empty", "torn"])
def test_a_damaged_file_is_compiled_and_written_again(computed, tmp_path, kind, damage):
    computed()
    (file,) = (tmp_path / "chosen").rglob(f"*.{kind}")
    file.write_bytes(damage(file.read_bytes()))
    assert computed() == "42.0 twice"
    assert computed() == "42.0 loaded"


def give_away(path: Path, monkeypatch) -> None:
    """Make a path belong to another user: root changes its owner, any other user pretends to be somebody else from then
    on.
    """
    if os.geteuid() == 0:
        os.chown(path, 65534, -1, follow_symlinks=False)
    else:
        monkeypatch.setattr(kernel_cache.os, "geteuid", lambda: 65534)


def linked(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


@pytest.mark.parametrize(("plant", "reason"), [
    (give_away, "it belongs to another user"),
    (lambda path, patch: os.chown(path, -1, 65534) or path.chmod(0o775), "other users can write it"),
    (lambda path, patch: path.chmod(0o707), "other users can write it"),
    (lambda path, patch: linked(path), "it is a link or no folder"),
], ids=["of another user", "another group may write", "world may write", "link"])
@pytest.mark.parametrize("place", ["the folder", "a file in it", "a folder above"])
def test_what_others_can_write_or_rename_is_neither_read_nor_written(tmp_path, monkeypatch, place, plant, reason):
    if os.geteuid() != 0 and "group" in reason:
        pytest.skip("only the superuser gives a file to another group")
    store = KernelStore(str(tmp_path / "chosen"))
    assert store.unusable == ""
    (store.path / "kernel.nbi").write_bytes(b"machine code")
    path = {"the folder": store.path, "a file in it": store.path / "kernel.nbi",
            "a folder above": store.path.parent}[place]
    plant(path, monkeypatch)
    again = KernelStore(str(tmp_path / "chosen"))
    if place == "a folder above" and "link" in reason:
        assert again.unusable == ""  # what it leads to is looked at
        return
    assert again.unusable.endswith(reason) and str(path) in again.unusable
    assert not again.path.is_relative_to(tmp_path / "chosen") and again.path.is_dir()


def test_a_sticky_folder_above_is_trusted(tmp_path):
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared").chmod(0o1777)
    assert KernelStore(str(tmp_path / "shared")).unusable == ""
    (tmp_path / "shared").chmod(0o777)
    assert KernelStore(str(tmp_path / "shared")).unusable == f"{tmp_path / 'shared'}: other users can write it"


def test_a_folder_that_cannot_be_made_is_told_and_replaced_for_this_process(computed, tmp_path):
    (tmp_path / "chosen").write_text("in the way")
    assert computed().startswith(f"42.0 twice {tmp_path / 'chosen'}/vibro_ros/kernels-")
    assert computed().endswith(": Not a directory")


def test_a_full_disk_is_told_and_the_kernel_runs(computed, tmp_path):
    computed()  # so that the limit hits nothing else that the compiler writes
    for file in kernels(tmp_path / "chosen"):
        file.unlink()
    assert computed("full").endswith(": File too large")
    assert computed() == "42.0 twice"


def test_folders_in_turn(monkeypatch, tmp_path):
    assert KernelStore("").path.parent == Path(kernel_cache.__file__).with_name("__pycache__")
    monkeypatch.setattr(kernel_cache.os, "access", lambda path, mode: "__pycache__" not in str(path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert KernelStore("").path.parent == tmp_path / "cache" / "vibro_ros"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert KernelStore("").path.parent == tmp_path / ".cache" / "vibro_ros"
    monkeypatch.setattr(kernel_cache.os.path, "expanduser", lambda path: path)  # a user whom no list knows
    assert "you cannot write it" in KernelStore("").unusable


def test_processes_that_fill_the_cache_together(computed, tmp_path):
    started = [subprocess.Popen([sys.executable, tmp_path / "program.py"], stdout=subprocess.PIPE, text=True)
               for _ in range(4)]
    assert [process.communicate(timeout=60)[0].split()[0] for process in started] == ["42.0"] * 4
    assert computed() == "42.0 loaded"
