"""Packaging. diffphys_ros/nodes, bags and msg_schemas are links to the top-level folders, so that they install inside the package."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "diffphys_ros"
NODES = ("ingest_node", "segment_node", "splat_node", "fit_node", "inspect_node", "graph")
VERSION = re.search(r'__version__ = "(.+)"', Path(NAME, "__init__.py").read_text(encoding="utf-8")).group(1)

setup(
    name=NAME,
    version=VERSION,
    description="Stiffness and force fields of a deforming object, recovered from one video; ROS 2 nodes",
    long_description=Path("README.md").read_text(encoding="utf-8") if Path("README.md").exists() else "",
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="diffphys_ros maintainers",
    maintainer_email="maintainers@diffphys-ros.org",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={f"{NAME}.nodes": ["*.xml"], f"{NAME}.bags": ["sample/*", "sample_strip/*"], f"{NAME}.prior": ["*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.py"))),
        (f"share/{NAME}/config", sorted([*glob("config/*"), f"{NAME}/nodes/fastdds.xml"])),
        # `ros2 run` looks here; pip puts console scripts into bin only, colcon overwrites these with its own
        (f"lib/{NAME}", [f"resource/bin/{node}" for node in NODES]),
    ],
    python_requires=">=3.11",
    install_requires=[
        "numpy>=1.26.4",
        "scipy>=1.13",
        "scikit-fem>=12.0",
        "torch>=2.6",
        "warp-lang>=1.10",
        "opencv-python-headless>=4.9",
        "mcap>=1.2",
        "mcap-ros2-support>=0.5.5",
        "rosbags>=0.11",
        "pyyaml>=6.0",
        "tqdm>=4.66",
        "matplotlib>=3.9",
    ],
    extras_require={
        # never above: pip would lay these wheels over an apt ROS, which has them all (package.xml)
        "ros": ["ros-rclpy[fastrtps]>=7.1.6", "ros-jazzy-common-interfaces>=5.3.6"],
        # recovery.rrd and inspect_node; an extra because it needs numpy 2, and an apt ROS has numpy 1.26
        "rerun": ["rerun-sdk>=0.31"],
        # segment.model and depth.model: SAM, SAM 2 and MiDaS-class networks
        "models": ["transformers>=5.0", "safetensors>=0.5", "pillow>=10"],
        # diffphys capture: structure from motion
        "capture": ["pycolmap>=4.0"],
        # diffphys batch --address; a wheel of 79 MB, 240 MB installed
        "ray": ["ray>=2.60"],
        "dev": ["pytest>=8,<9", "pytest-timeout>=2.3", "pytest-xdist>=3.6", "ruff>=0.6", "mypy>=1.11", "colcon-common-extensions>=0.3", "setuptools>=64,<80"],
    },
    entry_points={
        "console_scripts": [f"diffphys = {NAME}.__main__:main", *(f"{node} = {NAME}.nodes.executables:{node}" for node in NODES)],
    },
    zip_safe=False,
    classifiers=[
        "Intended Audience :: Science/Research",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering :: Physics",
    ],
)
