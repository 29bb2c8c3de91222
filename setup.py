"""The ament_python package semantic_slam: nodes, commands, launch files and configurations."""

from glob import glob

from setuptools import find_packages, setup

NAME = "semantic_slam"
NODES = ("bag_player", "bag_recorder", "classifier_node", "hypothesis_manager_node", "backend_node", "demo")
COMMANDS = (
    "import_dataset",
    "bag_to_report",
    "find_lookalike",
    "train_classifier",
    "fit_viewpoint_models",
    "train_latent_model",
)

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        f"{NAME}.messages": ["definitions/*.msg"],
        f"{NAME}.report": ["templates/*"],
        NAME: ["py.typed", "weights/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="semantic_slam maintainers",
    maintainer_email="maintainers@semantic-slam.invalid",
    description="Object-level semantic SLAM with a hybrid belief over poses, classes and data association",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            *(f"{name} = {NAME}.ros.{name}:main" for name in NODES),
            *(f"{name} = {NAME}.cli.{name}:main" for name in COMMANDS),
        ]
    },
)
