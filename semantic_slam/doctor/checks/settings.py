"""Whether a run with this configuration would start, and whether the input has what the configuration asks for."""

from collections.abc import Iterator

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.doctor.finding import Finding, error, of_fault, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.pipeline.detector_labels import with_labels
from semantic_slam.pipeline.idle_parameters import idle_parameters

NAME = "configuration"


def check(summary: InputSummary) -> Iterator[Finding]:
    for idle in idle_parameters(summary.configuration):
        yield warning(NAME, *idle)
    kind = class_model_kind(summary.configuration.semantic_model)
    has_boxes = summary.detections.num_messages > 0
    if kind.embeddings is not None and has_boxes and not summary.detections.has_embeddings:
        yield error(
            NAME,
            f"semantic_model.kind: {summary.configuration.semantic_model.kind}, and no detection of"
            f" {summary.found.detections} carries an embedding",
            "fill in embeddings, or set semantic_model.kind: detector to go by labels",
        )
    if summary.keyframes:
        yield from _start(summary)


def _start(summary: InputSummary) -> Iterator[Finding]:
    """What would end a run at one of the keyframes; the front end gives those of pictures no class scores."""
    first, prior = summary.keyframes[0], summary.prior
    try:
        labels = summary.detections.told_labels
        configuration = with_labels(summary.configuration, first.measurements, prior, labels)
        pose, covariance = initial_pose_of(configuration)
        problem = problem_of(make_run_configuration(configuration, prior, pose, covariance, stamp_ns=first.stamp_ns))
        for keyframe in summary.keyframes if not summary.found.has_images else ():
            problem.reader.step(keyframe)
    except InputError as fault:
        if not str(fault).startswith("map prior"):  # which has a check of its own
            yield of_fault(NAME, fault)
