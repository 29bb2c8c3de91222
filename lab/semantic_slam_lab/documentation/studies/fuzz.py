"""What nobody should send: to readers and the engine, and to nodes that run."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table
from semantic_slam_lab.documentation.writing.section import Section

CASES, FORGED = "fuzz", "forged_messages"


def targets(results: KeptResults) -> str:
    """A row for each reader."""
    rows = [(name, str(own["cases"]), str(own["findings"])) for name, own in results.at(f"{CASES}:targets").items()]
    return table(("fed", "cases", "findings"), rows)


def forgeries(results: KeptResults) -> str:
    """A row for each node and kind of forgery, and for each service."""
    return table(("to", "what", "number"), [tuple(row) for row in results.at(f"{FORGED}:forgeries")])


SECTIONS = (
    Section(
        CASES,
        "What nobody should feed it",
        "Valid files, messages and drives, each changed at random in bytes, numbers or fields, are read by what reads"
        " them in a run. A finding is an exception that is not the project's own, a message longer than a line, and a"
        " case that takes more CPU (in times of an ordinary machine) or memory than it may. Targets take turns.",
        (("", targets),),
        "make fuzz",
    ),
    Section(
        FORGED,
        "What nobody should send to nodes that run",
        "A demo of the shipped bag is sent messages that none of its nodes sends (garbage, fields that do not fit, of"
        " another run, out of protocol, repeated) and questions that have no answer, and is compared with one that is"
        " left in peace. What follows is what nodes had to count, and services to refuse.",
        (("", forgeries),),
        "python -m semantic_slam_lab.fuzz --live",
    ),
)
