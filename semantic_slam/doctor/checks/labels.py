"""Check of labels: unknown to the class models, or configured labels unknown to the detector."""

from collections.abc import Iterator

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.doctor.finding import Finding, error, of_fault
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError
from semantic_slam.pipeline.detector_labels import check_meant

NAME = "labels"
MOST_NAMED = 5


def check(summary: InputSummary) -> Iterator[Finding]:
    configuration, told = summary.configuration, summary.detections.told_labels
    if not told:
        return
    wanted, known = configuration.perception.labels, configuration.semantic_model.labels
    if wanted and not told & set(wanted):
        yield _none_of(f"perception.labels ({_named(wanted)})", told, "every detection is dropped")
        return
    kind = class_model_kind(configuration.semantic_model)
    if kind.labels is not None and known and not told & set(known):
        yield _none_of(f"semantic_model.labels ({_named(known)})", told, "every object is 'none of these'")
    if kind.labels is None and summary.found.has_images:
        try:
            check_meant(configuration, sorted(label for label in told if not wanted or label in wanted))
        except InputError as fault:
            yield of_fault(NAME, fault)


def _none_of(listed: str, told: frozenset[str], consequence: str) -> Finding:
    return error(
        NAME,
        f"none of {listed} is a label of the detections ({_named(sorted(told))}): {consequence}",
        "name labels that the detector has, as it writes them, or leave the list empty",
    )


def _named(labels: tuple[str, ...] | list[str]) -> str:
    return ", ".join(labels[:MOST_NAMED]) + (", …" if len(labels) > MOST_NAMED else "")
