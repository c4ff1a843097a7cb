"""Compare the bits of a 64-bit Arm computer, which is emulated, with the reference: `python -m tools.arm64`.

It needs Debian or Ubuntu with g++-aarch64-linux-gnu, mmdebstrap, qemu-user and debian-archive-keyring of apt. Debian's
Python for arm64 computes all cases of test/reference/digests.json: five minutes. `python -m tools.arm64 scene/ tables/`
computes those whose names begin so.
"""

import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIGESTS = ROOT / "test" / "reference" / "digests.py"
RELEASE, PYTHON = "bookworm", "3.11"  # of Debian, and its Python
PACKAGES = ("python3-minimal", f"libpython{PYTHON}-dev", "libstdc++6")
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_27_aarch64", "manylinux_2_28_aarch64")
NEEDED = ("lz4", "mcap", "numpy", "pyyaml", "rosbags", "zstandard")


def main(names: Sequence[str]) -> int:
    """Compute the cases, and print how many digests are those of the reference; returns 1 if one is not."""
    with tempfile.TemporaryDirectory() as folder:
        computed = json.loads(_digests(Path(folder), names or [""]))
    expected = json.loads(DIGESTS.with_suffix(".json").read_text())
    different = [name for name, digest in computed.items() if digest != expected[name]]
    print(f"arm64: {len(computed) - len(different)} of {len(computed)} digests are those of the reference")
    for name in different:
        print(f"arm64: other bits: {name}", file=sys.stderr)
    return bool(different) or not computed


def _digests(folder: Path, names: Sequence[str]) -> str:
    debian, site, copy, unit = (folder / name for name in ("debian", "site", "copy", "unit"))
    _run(["mmdebstrap", "--quiet", "--variant=extract", "--architectures=arm64", f"--include={','.join(PACKAGES)}",
          RELEASE, debian])
    _run([sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install", "--only-binary=:all:",
          *(f"--platform={platform}" for platform in PLATFORMS), f"--python-version={PYTHON}", f"--target={site}",
          f"--constraint={ROOT / 'requirements' / 'run.txt'}", *NEEDED])
    for name in ("vibro_ros", "config"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copy(ROOT / "package.xml", copy)  # beside which `config` is looked for
    _run([sys.executable, "-m", "vibro_ros.solver.unit", unit])
    _run([sys.executable, "-m", "cython", "-3", "--cplus", unit / "core.pyx"])
    includes = [unit, copy / "vibro_ros" / "solver", debian / "usr" / "include" / f"python{PYTHON}"]
    _run(["aarch64-linux-gnu-g++", *_flags(), *(f"-I{path}" for path in includes), "-idirafter",
          debian / "usr" / "include", "-shared", "-fPIC", unit / "core.cpp", "-o",
          copy / "vibro_ros" / "solver" / f"core.cpython-{PYTHON.replace('.', '')}-aarch64-linux-gnu.so"])
    environment = {"PYTHONPATH": f"{copy}{os.pathsep}{site}", "PYTHONDONTWRITEBYTECODE": "1"}
    return _run(["qemu-aarch64", "-L", debian, debian / "usr" / "bin" / f"python{PYTHON}", DIGESTS, *names],
                environment)


def _flags() -> list[str]:
    """Return the compiler's options for all processors, which setup.py has."""
    lines = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body
    return next(ast.literal_eval(line.value) for line in lines
                if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "FLAGS")


def _run(command: Sequence[str | Path], variables: Mapping[str, str] = {}) -> str:  # noqa: B006 (not changed)
    environment = {**os.environ, **variables}
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
