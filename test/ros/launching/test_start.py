"""Nodes start quickly: what only some runs need is loaded by those."""

import subprocess
import sys

import pytest

ALL = "backend_node, bag_player, bag_recorder, classifier_node, hypothesis_manager_node"
LINE = (
    f"import sys; from semantic_slam.ros import {ALL}; from semantic_slam.pipeline import offline;"
    " print(*sorted({'torch', 'scipy.stats', 'scipy.optimize', 'scipy.sparse.csgraph'} & set(sys.modules)))"
)


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_networks_statistics_and_graphs_wait_until_somebody_needs_them() -> None:
    told = subprocess.run([sys.executable, "-c", LINE], capture_output=True, text=True)
    assert (told.returncode, told.stdout.strip()) == (0, ""), told.stderr
