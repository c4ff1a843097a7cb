"""A package of types is installed completely or not at all, whatever step its installation stops at."""

import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest

from tools.interfaces.command import install, workshop
from tools.interfaces.definitions import InterfacePackage

PACKAGE = InterfacePackage("some_msgs", "1.0.0", "BSD", "Some.", {"msg/One.msg": "bool one\n"}, ("std_msgs",))


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    (tmp_path / "lib").mkdir()
    (tmp_path / "share").mkdir()
    python(tmp_path).parent.mkdir(parents=True)
    return tmp_path


def python(prefix: Path) -> Path:
    return Path(sysconfig.get_path("platlib", vars={"platbase": str(prefix)})) / PACKAGE.name


def files(prefix: Path) -> dict[str, str]:
    return {str(file.relative_to(prefix)): file.read_text() for file in prefix.rglob("*") if file.is_file()}


def made(folder: Path, content: str) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Return small stand-ins for the files that generation and compilation make."""
    for path in ("share/msg/One.msg", "python/__init__.py", "lib/libsome_msgs__a.so", "lib/libsome_msgs__b.so",
                 "lib/extension.so"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(content)
    lib = folder / "lib"
    return (SimpleNamespace(share=folder / "share", python=folder / "python"),
            SimpleNamespace(shared=sorted(lib.glob("lib*")), extension=lib / "extension.so"))


def install_into(prefix: Path, content: str) -> None:
    with workshop(prefix) as folder:
        install(PACKAGE, *made(folder, content), prefix)


def test_everything_is_where_ros_looks_for_it(prefix):
    install_into(prefix, "new")
    index = "share/ament_index/resource_index"
    found = files(prefix)
    assert "<name>some_msgs</name>" in found.pop("share/some_msgs/package.xml")
    assert found == {
        "share/some_msgs/msg/One.msg": "new", "lib/libsome_msgs__a.so": "new", "lib/libsome_msgs__b.so": "new",
        str(python(prefix).relative_to(prefix) / "__init__.py"): "new",
        str(python(prefix).relative_to(prefix) / "extension.so"): "new",
        f"{index}/packages/some_msgs": "", f"{index}/package_run_dependencies/some_msgs": "std_msgs",
        f"{index}/rosidl_interfaces/some_msgs": "msg/One.idl\nmsg/One.msg",
    }


@pytest.mark.parametrize("step", (1, 4, 6))
def test_nothing_stays_when_a_step_is_interrupted(prefix, monkeypatch, step):
    install_into(prefix, "old")
    old = files(prefix)
    done, rename, write = [], Path.rename, Path.write_text

    def counted(action):
        def one(path: Path, *words, **options):
            if str(path).startswith(str(prefix)) and "made" not in path.parts:
                done.append(path)
                if len(done) == step:
                    raise KeyboardInterrupt
            return action(path, *words, **options)
        return one

    with workshop(prefix) as folder:
        sources, libraries = made(folder, "new")
        monkeypatch.setattr(Path, "rename", counted(rename))
        monkeypatch.setattr(Path, "write_text", counted(write))
        with pytest.raises(KeyboardInterrupt):
            install(PACKAGE, sources, libraries, prefix)
        monkeypatch.undo()
    assert files(prefix) in ({}, old)
