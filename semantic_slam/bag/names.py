"""Normalisation of topic names in bags."""


def absolute(topic: str) -> str:
    """Absolute topic name: ``odom`` and ``/odom`` both become ``/odom``."""
    return "/" + topic.lstrip("/")
