"""Install vibro_ros with pip, or with colcon in a ROS 2 workspace."""

from pathlib import Path
from runpy import run_path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = ElementTree.parse("package.xml").getroot()  # name, version and the like are written there only
NAME = PACKAGE.findtext("name")
SHARE = f"share/{NAME}"
EXECUTABLES = run_path(f"{NAME}/process/executables.py")["EXECUTABLES"]  # not imported: what they need may be missing


def config_files() -> list[tuple[str, list[str]]]:
    """Return every file below config/ with the folder it is installed to."""
    files = sorted(file for file in Path("config").rglob("*") if file.is_file())
    return [(f"{SHARE}/{file.parent}", [str(file)]) for file in files]


setup(
    name=NAME,
    version=PACKAGE.findtext("version"),
    description=PACKAGE.findtext("description"),
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    project_urls={url.get("type").capitalize(): url.text for url in PACKAGE.iterfind("url")},
    maintainer=PACKAGE.findtext("maintainer"),
    maintainer_email=PACKAGE.find("maintainer").get("email"),
    license=PACKAGE.findtext("license"),
    classifiers=[
        "Development Status :: 5 - Production/Stable",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(11, 15)),
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.view": ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", sorted(map(str, Path("examples/launch").glob("*.launch.py")))),
        *config_files(),
    ],
    zip_safe=True,
    python_requires=">=3.11,<3.15",
    install_requires=["llvmlite", "lz4", "matplotlib", "mcap>=1.5", "numba", "numpy", "pillow", "PyYAML",
                      "rosbags>=0.11", "scipy", "tornado", "tqdm", "zstandard"],
    extras_require={
        # ROS 2 Jazzy as wheels; not asked for by default, so that an apt installation is never shadowed.
        "ros": [
            "ros-jazzy-diagnostic-msgs",
            "ros-jazzy-geometry-msgs",
            "ros-jazzy-nav-msgs",
            "ros-jazzy-rclpy==7.1.6",
            "ros-jazzy-rmw-fastrtps-cpp",
            "ros-jazzy-sensor-msgs",
            "ros-jazzy-std-msgs",
            "ros-jazzy-std-srvs",
        ],
        # The documents as web pages.
        "site": ["mkdocs", "mkdocs-material", "mkdocstrings-python"],
        "test": [
            "catkin-pkg",
            "cmeel-urdfdom",
            "codespell",
            "colcon-common-extensions",
            'cyclonedds ; python_version < "3.14"',  # a peer by another vendor's DDS; no wheel beyond
            "mpmath",
            "mypy",
            "oxlint",
            "packaging",
            "pandas",
            "playwright",  # steers a browser
            "polars",
            "pytest",
            "pytest-rerunfailures",
            "pytest-xdist",
            "python-flint",
            "ruff",
            "setuptools",  # colcon-core asks for one below 80
        ],
    },
    entry_points={
        "console_scripts": [
            f"{name} = {NAME}.process.entry_point:{name}" for name, one in EXECUTABLES.items() if one.installed
        ],
    },
)
