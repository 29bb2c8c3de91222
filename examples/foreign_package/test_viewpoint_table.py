"""The table keeps the contract of class models."""

import pytest
from viewpoint_table import ViewpointTable, read_table

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.contracts.viewpoint_model import ViewpointModelContract


class TestViewpointTable(ViewpointModelContract):
    @pytest.fixture
    def model(self) -> ViewpointTable:
        return read_table(SemanticModelConfiguration())
