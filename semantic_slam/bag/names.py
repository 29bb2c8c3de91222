"""Topic names as bags hold them."""


def absolute(topic: str) -> str:
    """The topic's name from the root of the graph: ``odom`` and ``/odom`` are both ``/odom``."""
    return "/" + topic.lstrip("/")
