"""Check of the prior map: its classes or frame do not match the run."""

from collections.abc import Iterator

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.doctor.finding import Finding, error, of_fault
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError

NAME = "map prior"
MOST_NAMED = 5


def check(summary: InputSummary) -> Iterator[Finding]:
    prior, settings = summary.prior, summary.configuration.semantic_model
    if prior is None:
        return
    told = {name for item in prior.objects for name in item.class_probabilities}
    try:
        model = load_model(settings)
        kind = class_model_kind(settings)
    except InputError as fault:
        yield of_fault(NAME, fault)
        return
    if model is not None:
        known = set(model.class_names)
    elif kind.labels is not None and settings.labels:
        known = {*settings.labels, "none of these"}
    else:
        return
    strange = sorted(told - known)
    if strange:
        lost = sum(bool(set(item.class_probabilities) - known) for item in prior.objects)
        yield error(
            NAME,
            f"{lost} of {len(prior.objects)} objects have classes ({', '.join(strange[:MOST_NAMED])}) that"
            f" semantic_model.kind: {settings.kind} does not have ({', '.join(sorted(known)[:MOST_NAMED])})",
            "give the map of a run with the same class models, rename its classes, or remove class_probabilities",
        )
