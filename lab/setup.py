"""Install vibro_lab with pip, or with colcon in a ROS 2 workspace, beside vibro_ros."""

from runpy import run_path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = ElementTree.parse("package.xml").getroot()  # name, version and the like are written there only
NAME = PACKAGE.findtext("name")
EXECUTABLES = run_path(f"{NAME}/executables.py")["EXECUTABLES"]  # not imported: what they need may be missing

setup(
    name=NAME,
    version=PACKAGE.findtext("version"),
    description=PACKAGE.findtext("description"),
    project_urls={url.get("type").capitalize(): url.text for url in PACKAGE.iterfind("url")},
    maintainer=PACKAGE.findtext("maintainer"),
    maintainer_email=PACKAGE.find("maintainer").get("email"),
    license=PACKAGE.findtext("license"),
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_dir={"": "."},  # an editable installation then also finds `benchmark` and `research`, which do not ship
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    zip_safe=True,
    python_requires=">=3.11,<3.15",
    # All but the last are the device's as well.
    install_requires=["matplotlib", "numpy", "PyYAML", "scipy", "tqdm", "vibro_ros>=2"],
    extras_require={
        # What the studies need beyond the robot: tables of results, and searches for an optimum.
        "study": ["cma", "pyarrow"],
        # The environment of the room `gym`.
        "gym": ["gymnasium"],
        # Sweeps on more than one machine.
        "cluster": ["distributed"],
        # What benchmark and tests compare with: a peer of 104 MB, and the compiler of Runge-Kutta methods.
        "bench": ["heyoka==7.13.2", "numba"],
    },
    entry_points={"console_scripts": [f"{name} = {NAME}.executables:{name}" for name in EXECUTABLES]},
)
