"""The laboratory's version is that of semantic_slam, whose package.xml has it; the rest stands in pyproject.toml."""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import setup

VERSION = ElementTree.parse(Path(__file__).resolve().parents[1] / "package.xml").findtext("version")

setup(
    version=VERSION,
    install_requires=[
        f"semantic_slam[train,efficientnet]=={VERSION}",
        "gtsam",
        "h5py",
        "jinja2",
        "joblib~=1.6",
        "matplotlib",
        "mujoco~=4.0",
        "numpy",
        "opencv-python-headless",
        "pyyaml",
        "rosbags",
        "scikit-learn",
        "scipy",
        "torch",
        "tqdm",
    ],
)
