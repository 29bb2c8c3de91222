"""ROS graph of a running system: publishers, subscriptions, their QoS, and the diagnostics of our nodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Endpoint:
    """Publisher or subscription of one topic."""

    node: str
    type_name: str  # package/msg/Name
    is_reliable: bool = True
    is_latched: bool = False  # TRANSIENT_LOCAL: who comes late has what was published before, or asks for it


@dataclass(frozen=True)
class Said:
    """One status of /diagnostics."""

    level: int  # 0 good, 1 warning, 2 error
    name: str
    message: str


@dataclass(frozen=True, kw_only=True)
class Graph:
    """State of the graph. Topics have the names used by our nodes, before remapping."""

    publishers: Mapping[str, Sequence[Endpoint]]
    readers: Mapping[str, Sequence[Endpoint]]
    nodes: frozenset[str]  # of our namespace
    num_backends: int = 0  # that give a sign of life
    said: Sequence[Said] = field(default=())  # the newest of each name
