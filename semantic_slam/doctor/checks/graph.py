"""Check of a running system's ROS graph: quality of service, missing nodes, and nodes that report faults."""

from collections.abc import Iterator

from semantic_slam.doctor.finding import Finding, Severity, error, warning
from semantic_slam.doctor.graph import Endpoint, Graph

MANAGER, CLASSIFIER = "hypothesis_manager", "classifier"
MEASUREMENTS = "/classifier/measurements"
OPTIONAL = "/initialpose"
"""A run starts without it."""


def check(graph: Graph) -> Iterator[Finding]:
    yield from _types(graph)
    yield from _quality(graph)
    yield from _nodes(graph)
    for said in graph.said:
        if said.level > 0:
            severity = Severity.ERROR if said.level > 1 else Severity.WARNING
            what, _, remedy = said.message.partition("; ")
            yield Finding(severity, said.name, what, remedy or "see docs/troubleshooting.md")


def _types(graph: Graph) -> Iterator[Finding]:
    for topic in sorted({*graph.publishers} & {*graph.readers}):
        for reader in graph.readers[topic]:
            others = [each for each in graph.publishers[topic] if each.type_name != reader.type_name]
            for publisher in others:
                yield error(
                    "types",
                    f"{topic}: {publisher.node} publishes {publisher.type_name} and {reader.node} reads"
                    f" {reader.type_name}",
                    f"remap one of them: -r {topic[1:]}:=/your/topic",
                )


def _quality(graph: Graph) -> Iterator[Finding]:
    for topic in sorted({*graph.publishers} & {*graph.readers}):
        for publisher in graph.publishers[topic]:
            for reader in graph.readers[topic]:
                yield from _pair(topic, publisher, reader)


def _pair(topic: str, publisher: Endpoint, reader: Endpoint) -> Iterator[Finding]:
    pair = f"{topic}: {publisher.node} publishes"
    if reader.is_reliable and not publisher.is_reliable:
        what = f"{pair} best effort and {reader.node} wants it reliable: not one message arrives"
        yield error("quality of service", what, f"publish it RELIABLE, or set lossless:=false on {reader.node}")
    elif reader.is_latched and not publisher.is_latched:
        what = f"{pair} volatile and {reader.node} wants it transient local: not one message arrives"
        say = warning if topic == OPTIONAL else error
        where = "RViz: Durability Policy of its tool" if topic == OPTIONAL else "as static transforms are"
        yield say("quality of service", what, f"publish {topic} TRANSIENT_LOCAL ({where})")


def _nodes(graph: Graph) -> Iterator[Finding]:
    if MANAGER in graph.nodes and not graph.num_backends:
        yield error(
            "nodes",
            f"{MANAGER} runs and no backend answers",
            "start as many as its parameter backends says: ros2 run semantic_slam backend_node",
        )
    if MANAGER in graph.nodes and not graph.publishers.get(MEASUREMENTS):
        yield error(
            "nodes",
            f"{MANAGER} runs and nobody publishes {MEASUREMENTS}",
            "start the classifier: ros2 run semantic_slam classifier_node",
        )
    if CLASSIFIER in graph.nodes and MANAGER not in graph.nodes:
        yield warning(
            "nodes",
            f"{CLASSIFIER} runs and no {MANAGER} takes its measurements",
            "start it: ros2 run semantic_slam hypothesis_manager_node",
        )
