"""Why a hypothesis has to be given up."""

from semantic_slam.errors import SemanticSlamError


class LostComponentError(SemanticSlamError):
    """A component's linear system is indeterminate; its hypothesis has to be given up."""
