"""Messages of the two rounds of a keyframe, and of the run configuration."""

from itertools import chain, pairwise
from typing import Any

import numpy as np

from semantic_slam.errors import MessageError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.clock_offset import OFFSETS
from semantic_slam.inference.object_table import QUANTITIES, ObjectTable, columns
from semantic_slam.inference.protocol import Candidates, Commit, Components, MissedKeyframes, RunConfiguration
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.messages.layout import Layout, MayBeEmpty, contents, filled, unpack
from semantic_slam.messages.lineage_changes import changes_in, padded, step_of, with_changes
from semantic_slam.messages.measurements import measurements_from_message, measurements_to_message
from semantic_slam.messages.objects import object_layout
from semantic_slam.messages.standard import (
    covariance_matrix,
    covariance_pose_message,
    header_message,
    header_stamp_ns,
    pose_vector,
)

RUN_TYPE = "semantic_slam_msgs/msg/RunConfiguration"
KEYFRAME_TYPE = "semantic_slam_msgs/msg/Keyframe"
CANDIDATES_TYPE = "semantic_slam_msgs/msg/Candidates"
COMMIT_TYPE = "semantic_slam_msgs/msg/Commit"
COMPONENTS_TYPE = "semantic_slam_msgs/msg/Components"
MISSED_TYPE = "semantic_slam_msgs/msg/MissedKeyframes"

RUN_LAYOUT: Layout = {"class_names": ("C",)}

KEYFRAME_LAYOUT: Layout = {
    "odometry_slopes": MayBeEmpty((3, 3)),
    "odometry_shifts": MayBeEmpty((len(OFFSETS), 3)),
    "level": MayBeEmpty((4,)),
}

CANDIDATES_LAYOUT: Layout = {
    "ids": ("K",),
    "parent_ids": ("K",),
    "associations": ("K", "D"),
    "class_assignments": ("K", "D"),
    "modes": ("K",),
    "log_weights": ("K",),
    "effective_sample_sizes": ("K",),
    "innovation_nees": ("K",),
    "outlier_probability": ("K", "D"),
    "poses": ("K", 7),
    "pose_covariances": ("K", 6, 6),
    "object_poses": ("K", "D", 7),
    "object_covariances": ("K", "D", 6, 6),
    "expanded_parent_ids": ("P",),
    "log_mass_not_enumerated": ("P",),
}

COMMIT_LAYOUT: Layout = {
    "ids": ("S",),
    "parent_ids": ("S",),
    "associations": ("S", "D"),
    "class_assignments": ("S", "D"),
    "modes": ("S",),
    "log_weights": ("S",),
    "owners": ("S",),
    "lineage_lengths": ("S",),
    "lineage_modes": ("N",),
    "lineage_detections": ("N",),
    "lineage_associations": ("M",),
    "lineage_class_assignments": ("M",),
}
"""N lineage steps over all survivors, M detections over all those steps."""

COMPONENTS_LAYOUT: Layout = {
    "ids": ("S",),
    "poses": ("S", 7),
    "pose_covariances": ("S", 6, 6),
    "object_ids": ("O",),
    **object_layout("S", "O"),
    "lost_ids": ("X",),
    "lost_reasons": ("X",),
    "noise": ("S", "N", 2),
}

CANDIDATES_TOLD: Layout = {**CANDIDATES_LAYOUT, "associations": ("K", "W")}
COMMIT_TOLD: Layout = {**COMMIT_LAYOUT, "associations": ("S", "W")}
"""W is D, or more where histories are changed: see ``lineage_changes``."""


def run_to_message(value: RunConfiguration) -> Any:
    return filled(
        RUN_TYPE,
        RUN_LAYOUT,
        vars(value),
        header=header_message(value.stamp_ns, "map"),
        initial_pose=covariance_pose_message(value.initial_pose, value.initial_covariance),
    )


def run_from_message(message: Any) -> RunConfiguration:
    return RunConfiguration(
        stamp_ns=header_stamp_ns(message),
        initial_pose=pose_vector(message.initial_pose.pose),
        initial_covariance=covariance_matrix(message.initial_pose),
        **contents(RUN_TYPE, RUN_LAYOUT, message),
    )


def keyframe_to_message(value: Keyframe, run_id: str, *, again: bool = False) -> Any:
    """Keyframe message of the run ``run_id``; ``again``: resent for backends that have missed it."""
    told = {name: getattr(value, name) for name in KEYFRAME_LAYOUT}
    arrays = {name: np.zeros(0) if array is None else array for name, array in told.items()}
    return filled(
        KEYFRAME_TYPE,
        KEYFRAME_LAYOUT,
        {"run_id": run_id, "keyframe": value.index, "again": again, "level_to_come": value.is_level_to_come, **arrays},
        header=header_message(value.stamp_ns, "map"),
        odometry=covariance_pose_message(value.odometry, value.odometry_covariance),
        measurements=measurements_to_message(value.measurements),
    )


def keyframe_from_message(message: Any) -> Keyframe:
    """Keyframe of a message; the run id (``message.run_id``) and ``message.again`` are not part of it."""
    told = unpack(KEYFRAME_TYPE, KEYFRAME_LAYOUT, message)
    arrays: dict[str, Any] = {name: array if array.size else None for name, array in told.items()}
    return Keyframe(
        index=int(message.keyframe),
        stamp_ns=header_stamp_ns(message),
        odometry=pose_vector(message.odometry.pose),
        odometry_covariance=covariance_matrix(message.odometry),
        measurements=measurements_from_message(message.measurements),
        is_level_to_come=bool(message.level_to_come),
        **arrays,
    )


def candidates_to_message(value: Candidates) -> Any:
    associations = value.associations
    if any(value.changes):
        rows = zip(associations.tolist(), value.changes, strict=True)
        associations = padded([with_changes(own, changes) for own, changes in rows])
    return filled(CANDIDATES_TYPE, CANDIDATES_TOLD, {**vars(value), "associations": associations})


def candidates_from_message(message: Any) -> Candidates:
    values = contents(CANDIDATES_TYPE, CANDIDATES_TOLD, message)
    both, count = values["associations"], values["class_assignments"].shape[1]
    if both.shape[1] < count:
        raise MessageError(f"{CANDIDATES_TYPE}.associations: {both.shape[1]} of {count} detections")
    values["associations"] = both[:, :count]
    changes = tuple(changes_in(row) for row in both[:, count:].tolist())
    return Candidates(changes=changes if any(changes) else (), **values)


def components_to_message(value: Components) -> Any:
    return filled(COMPONENTS_TYPE, COMPONENTS_LAYOUT, vars(value) | columns(value.objects))


def components_from_message(message: Any) -> Components:
    values = contents(COMPONENTS_TYPE, COMPONENTS_LAYOUT, message)
    objects = ObjectTable(**{name: values.pop(name) for name in QUANTITIES})
    return Components(objects=objects, **values)


def commit_to_message(value: Commit) -> Any:
    lineage = list(chain.from_iterable(value.lineages))
    count = len(value.steps[0].association) if value.steps else 0
    associations = padded([with_changes(step.association, step.changes) for step in value.steps])
    told = [with_changes(step.association, step.changes) for step in lineage]
    classes = [padded([step.class_assignment], len(own))[0] for step, own in zip(lineage, told, strict=True)]
    arrays = {
        **vars(value),
        "associations": associations,
        "class_assignments": padded([step.class_assignment for step in value.steps], count),
        "modes": [step.mode for step in value.steps],
        "lineage_lengths": [len(steps) for steps in value.lineages],
        "lineage_modes": [step.mode for step in lineage],
        "lineage_detections": [len(own) for own in told],
        "lineage_associations": list(chain.from_iterable(told)),
        "lineage_class_assignments": list(chain.from_iterable(classes)),
    }
    return filled(COMMIT_TYPE, COMMIT_TOLD, arrays)


def commit_from_message(message: Any) -> Commit:
    arrays = contents(COMMIT_TYPE, COMMIT_TOLD, message)
    return Commit(
        run_id=arrays["run_id"],
        keyframe=arrays["keyframe"],
        ids=arrays["ids"],
        parent_ids=arrays["parent_ids"],
        steps=tuple(
            step_of(association, classes, mode)
            for association, classes, mode in zip(
                arrays["associations"].tolist(),
                arrays["class_assignments"].tolist(),
                arrays["modes"].tolist(),
                strict=True,
            )
        ),
        log_weights=arrays["log_weights"],
        owners=arrays["owners"],
        lineages=_lineages(arrays),
    )


def _lineages(arrays: dict[str, Any]) -> tuple[Lineage, ...]:
    """Split the concatenated lineage steps by each survivor's length and each step's number of detections."""
    lengths, detections = arrays["lineage_lengths"], arrays["lineage_detections"]
    if lengths.sum() != len(detections) or detections.sum() != len(arrays["lineage_associations"]):
        raise MessageError(f"{COMMIT_TYPE}.lineage_lengths: they do not add up to the lineage's steps and detections")
    ends = np.cumsum(detections)[:-1]
    steps = [
        step_of(association.tolist(), classes.tolist(), int(mode))
        for association, classes, mode in zip(
            np.split(arrays["lineage_associations"], ends),
            np.split(arrays["lineage_class_assignments"], ends),
            arrays["lineage_modes"],
            strict=False,
        )
    ]
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(int)
    return tuple(tuple(steps[begin:end]) for begin, end in pairwise(starts))


def missed_to_message(value: MissedKeyframes) -> Any:
    return filled(MISSED_TYPE, {}, vars(value))


def missed_from_message(message: Any) -> MissedKeyframes:
    return MissedKeyframes(**contents(MISSED_TYPE, {}, message))
