"""The contents of ``report.json``, ``objects.json`` and ``trajectory.tum``."""

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.evaluation.evaluate import Evaluation, evaluate
from semantic_slam.evaluation.history import associated_objects, best_history, best_index, histories, lineage
from semantic_slam.evaluation.record import Record, json_object
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.from_belief import ancestors_of, mapped_rows
from semantic_slam.report.plain_json import plain
from semantic_slam.report.start import Start, start_of

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Analysis:
    """A record, with what every part of a report needs to know about it."""

    record: Record
    bag: dict[str, Any]  # path, sha256 and number of keyframes of the input
    configuration: dict[str, Any]
    start: Start  # before the first keyframe, as used
    ancestors: list[int]  # (K,) index of the ancestor of the final best hypothesis, -1 unknown
    evaluation: Evaluation | None  # None without ground truth
    detection_counts: Counter[int]  # object id -> detections it explains in the end
    seen_by_some: frozenset[int]  # ids of objects that explain a detection under some hypothesis in the end


def analyse(record: Record, belief_bag: Path, belief_bag_sha256: str) -> Analysis:
    """Everything derived from the record once. Input that names no source is described by the belief bag itself."""
    source = json_object(record.run.source)
    bag = {
        "path": str(source.get("path") or belief_bag),
        "sha256": str(source.get("sha256") or belief_bag_sha256),
        "n_keyframes": len(record.beliefs),
        "belief_bag": str(belief_bag),
    }
    ancestors = lineage(record.beliefs)
    counts = Counter(int(number) for found in best_history(record.beliefs) if found is not None for number in found)
    some = frozenset(number for found in histories(record.beliefs) for number in found.ravel().tolist())
    evaluation = evaluate(record, record.truth) if record.truth else None
    configuration = json_object(record.run.configuration)
    start = start_of(record.run, configuration)
    return Analysis(record, bag, configuration, start, ancestors, evaluation, counts, some)


def report_document(analysis: Analysis) -> dict[str, Any]:
    """``report.json``; NaN still inside, see :mod:`plain_json`."""
    record = analysis.record
    document = {
        "schema_version": SCHEMA_VERSION,
        "bag": analysis.bag,
        "config": analysis.configuration,
        "seed": analysis.configuration.get("seed"),
        "revision": record.run.revision,
        "run_id": record.run.run_id,
        "start": asdict(analysis.start),
        "keyframes": [
            _keyframe(belief, index) for belief, index in zip(record.beliefs, analysis.ancestors, strict=True)
        ],
        "objects": object_rows(analysis),
        "noise": noise_row(record.beliefs[-1]),
        "dropped": record.dropped,
    }
    if record.carried:
        document["carried"] = [list(span) for span in record.carried]
    if record.fault:
        document["fault"] = record.fault
    if analysis.evaluation:
        document["metrics"] = analysis.evaluation.metrics
    return document


def _keyframe(belief: HybridBelief, final: int) -> dict[str, Any]:
    best = _hypothesis(belief, best_index(belief))
    return {
        "k": belief.keyframe,
        "stamp_ns": belief.stamp_ns,
        "n_detections": len(belief.detection_ids),
        "n_candidates": belief.num_candidates,
        "n_hypotheses": len(belief.hypothesis_ids),
        "association_entropy": belief.association_entropy,
        "component_entropy": belief.component_entropy,
        "discarded_mass": belief.discarded_mass,
        **_explanation(belief),
        "best": best,
        "associations": best["associations"],
        "final": _hypothesis(belief, final) if final >= 0 else None,
    }


def _explanation(belief: HybridBelief) -> dict[str, float]:
    """What a belief says of its data; nothing where an older version recorded it, which did not say."""
    if np.isnan(belief.log_evidence):
        return {}
    names = ("discarded_mass_window", "log_evidence", "innovation_nees", "unexplained")
    return {name: getattr(belief, name) for name in names}


def _hypothesis(belief: HybridBelief, index: int) -> dict[str, Any]:
    return {
        "id": int(belief.hypothesis_ids[index]),
        "weight": float(np.exp(belief.log_weights[index])),
        "pose": belief.poses[index],
        "associations": associated_objects(belief)[index],
    }


def object_rows(analysis: Analysis) -> list[dict[str, Any]]:
    """The objects of the last belief."""
    last = analysis.record.beliefs[-1]
    return [
        {
            "id": int(number),
            "name": last.object_names[row],
            "class_probabilities": dict(zip(last.class_names, last.class_probabilities[row].tolist(), strict=True)),
            "existence": last.existence[row],
            "moving": last.moving[row],
            "moved": last.moved[row],
            "missing": last.missing[row],
            "velocity": last.object_velocities[row, :3],
            "pose": last.object_poses[row],
            "covariance": last.object_covariances[row],
            "places": _places(last, row),
            "mutual_information": last.mutual_information[row],
            "in_coverage": bool(last.in_coverage[row]),
            "forgotten_views": int(last.forgotten_views[row]),
            "n_detections": analysis.detection_counts[int(number)],
            "descriptor": last.descriptors[row],
            "descriptor_variance": last.descriptor_covariances[row],
        }
        for row, number in enumerate(last.object_ids)
    ]


def _places(belief: HybridBelief, row: int) -> list[dict[str, Any]]:
    """Where an object may be, likeliest first, if the hypotheses disagree on it; [] if they agree."""
    places = belief.places_of(row)
    return [plain(vars(place)) for place in places] if len(places) > 1 else []


def noise_row(belief: HybridBelief) -> dict[str, dict[str, float]]:
    """What a belief says of the noise: value and standard deviation by the configuration's names."""
    values, sigmas = belief.noise_values.tolist(), belief.noise_sigmas.tolist()
    noise = zip(belief.noise_names, values, sigmas, strict=True)
    return {name: {"value": value, "sigma": sigma} for name, value, sigma in noise}


def map_prior(record: Record) -> MapPrior:
    """The last belief's objects as the map prior of a later run.

    Those that no hypothesis has placed are left out, and those that move: they are elsewhere by then.
    """
    last = record.beliefs[-1]
    rows, settings = mapped_rows(last, record.run), json_object(record.run.configuration).get("semantic_model", {})
    return MapPrior(
        tuple(
            ObjectPrior(
                object_id=int(number),
                name=last.object_names[row] or str(number),
                pose=last.object_poses[row],
                covariance=last.object_covariances[row],
                class_probabilities=dict(zip(last.class_names, last.class_probabilities[row].tolist(), strict=True)),
                existence=float(last.existence[row]),
                **_descriptor(last, row),
            )
            for row, number in zip(rows.tolist(), last.object_ids[rows], strict=True)
        ),
        str(settings.get("space", "")),
        state_space=last.state_space,
        ancestors=ancestors_of(record.run),
    )


def objects_document(record: Record) -> dict[str, Any]:
    """``objects.json``: :func:`map_prior`, with the places of objects that may be in several."""
    document, last = map_prior(record).document(), record.beliefs[-1]
    by_id = {int(number): row for row, number in enumerate(last.object_ids)}
    for item in document["objects"]:
        if places := _places(last, by_id[item["id"]]):
            item["places"] = places
    return document


def _descriptor(belief: HybridBelief, row: int) -> dict[str, Array]:
    """What is known of an object's descriptor; nothing where that is not a number."""
    mean, variance = belief.descriptors[row], belief.descriptor_covariances[row]
    return {"descriptor": mean, "descriptor_variance": variance} if np.isfinite([mean, variance]).all() else {}


def tum_lines(analysis: Analysis) -> str:
    """One line ``seconds x y z qx qy qz qw`` per keyframe: the path of the hypothesis that is best at the end.

    Where its lineage is not recorded, the best hypothesis of that keyframe stands in.
    """
    lines = []
    for belief, final in zip(analysis.record.beliefs, analysis.ancestors, strict=True):
        seconds, nanoseconds = divmod(belief.stamp_ns, 1_000_000_000)
        pose = belief.poses[final if final >= 0 else best_index(belief)]
        lines.append(f"{seconds}.{nanoseconds:09d} " + " ".join(f"{value:.9g}" for value in pose))
    return "\n".join(lines) + "\n"
