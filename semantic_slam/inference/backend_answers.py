"""Answers of a backend to the manager: candidates of an expansion, and the marginals of components."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.expander import Expansion
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.object_table import without_views
from semantic_slam.inference.protocol import Candidates, Components
from semantic_slam.inference.reported.class_marginals import add_class_marginals
from semantic_slam.inference.reported.component_marginals import (
    ComponentMarginals,
    aligned_marginals,
    existence_marginals,
    motion_marginals,
)
from semantic_slam.inference.reported.descriptor_marginals import descriptor_marginals
from semantic_slam.inference.reported.displaced_marginals import displaced_marginals
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.objects import ReportedObjects
from semantic_slam.inference.world.problem import Problem


class Answers:
    """Makes the messages of one backend in one run."""

    def __init__(self, run_id: str, backend_id: int, problem: Problem) -> None:
        self._run_id, self._backend_id, self._problem = run_id, backend_id, problem

    def candidates(self, step: Step, expansion: Expansion, parents: list[int]) -> Candidates:
        """The candidates of an ``expansion`` of ``parents``, the ids of hypotheses."""
        rows, robot, landmark = expansion.assignments, self._problem.spaces.robot, self._problem.spaces.landmark
        states, covariances = self._of_all_detections(step, expansion)
        own = expansion.parents
        return Candidates(
            run_id=self._run_id,
            keyframe=step.index,
            backend_id=self._backend_id,
            ids=np.array(expansion.ids, dtype=np.uint64),
            parent_ids=np.array(own.ids, dtype=np.uint64)[rows.parents],
            associations=_rows([s.association for s in expansion.steps], len(step.names)),
            class_assignments=_rows([s.class_assignment for s in expansion.steps], len(step.names)),
            modes=np.array([s.mode for s in expansion.steps], dtype=np.uint16),
            changes=tuple(s.changes for s in expansion.steps),
            log_weights=own.log_weights[rows.parents] + expansion.log_psi,
            effective_sample_sizes=expansion.effective_sample_sizes,
            innovation_nees=_or_nan(rows.innovation_nees, len(rows)),
            outlier_probability=_of_outliers(step, expansion),
            poses=robot.poses(rows.column("robot")),
            pose_covariances=robot.covariances(rows.column("robot"), rows.column("robot_covariance")),
            object_poses=landmark.poses(states),
            object_covariances=landmark.covariances(states, covariances),
            expanded_parent_ids=np.array(parents, dtype=np.uint64),
            log_mass_not_enumerated=own.log_sums(own.log_weights + expansion.log_left_out, parents),
        )

    def _of_all_detections(self, step: Step, expansion: Expansion) -> tuple[Array, Array]:
        """(K, D, s) states and (K, D, l, l) covariances of the detected objects, NaN for detections not used."""
        landmark, shape = self._problem.spaces.landmark, (len(expansion.ids), len(step.names))
        states = np.full((*shape, landmark.storage_size), np.nan)
        covariances = np.full((*shape, landmark.tangent_size, landmark.tangent_size), np.nan)
        states[:, expansion.used] = expansion.assignments.column("object_states")
        covariances[:, expansion.used] = expansion.assignments.column("object_covariances")
        return states, covariances

    def no_candidates(self, step: Step, expanded: Sequence[int] = ()) -> Candidates:
        """An answer without candidates: no parent is held, or the ``expanded`` ones have no possible continuation."""
        detections = len(step.names)
        none, parents = np.zeros(0), np.zeros(0, dtype=np.uint64)
        return Candidates(
            run_id=self._run_id,
            keyframe=step.index,
            backend_id=self._backend_id,
            ids=parents,
            parent_ids=parents,
            associations=_rows([], detections),
            class_assignments=_rows([], detections),
            modes=np.zeros(0, dtype=np.uint16),
            log_weights=none,
            effective_sample_sizes=none,
            innovation_nees=none,
            outlier_probability=np.zeros((0, detections)),
            poses=np.zeros((0, 7)),
            pose_covariances=np.zeros((0, 6, 6)),
            object_poses=np.zeros((0, detections, 7)),
            object_covariances=np.zeros((0, detections, 6, 6)),
            expanded_parent_ids=np.array(expanded, dtype=np.uint64),
            log_mass_not_enumerated=np.full(len(expanded), -np.inf),
        )

    def components(
        self,
        keyframe: int,
        held: Mapping[int, Component],
        marginals: Sequence[ComponentMarginals],
        reported: ReportedObjects,
        lost: Mapping[int, str],
    ) -> Components:
        """Marginals of the components by hypothesis, of which ``marginals`` are known, and why others are lost."""
        components = list(held.values())
        poses, covariances, existence = self._in_map(marginals, len(reported.ids))
        descriptors = [descriptor_marginals(component, reported, self._problem.embeddings) for component in components]
        objects = without_views(
            len(components),
            reported.class_prior,
            object_poses=poses[:, 1:],
            object_covariances=covariances[:, 1:],
            existence=existence,
            **motion_marginals(components, reported),
            **existence_marginals(components, reported),
            **displaced_marginals(self._problem, components, reported),
            descriptors=_stacked([known.mean for known in descriptors], len(reported.ids)),
            descriptor_covariances=_stacked([known.variance for known in descriptors], len(reported.ids)),
        )
        add_class_marginals(objects, components, reported, self._problem.novelty_false_alarms)
        return Components(
            run_id=self._run_id,
            keyframe=keyframe,
            backend_id=self._backend_id,
            ids=np.array(list(held), dtype=np.uint64),
            poses=poses[:, 0],
            pose_covariances=covariances[:, 0],
            object_ids=np.array(reported.ids, dtype=np.uint32),
            objects=objects,
            lost_ids=np.array(list(lost), dtype=np.uint64),
            lost_reasons=tuple(lost.values()),
            noise=self._noise(components),
        )

    def _noise(self, components: Sequence[Component]) -> Array:
        """(S, N, 2) means and standard deviations of the noise parameters that components infer."""
        moments = [self._problem.inferred_noise.moments(component) for component in components]
        return np.array(moments) if moments else np.zeros((0, 0, 2))

    def _in_map(self, marginals: Sequence[ComponentMarginals], num_objects: int) -> tuple[Array, Array, Array]:
        """(H, 1 + O, 7) poses, (H, 1 + O, 6, 6) covariances in map and (H, O) existence, NaN for absent objects."""
        states, spread, existence = aligned_marginals(marginals, num_objects, self._problem.spaces)
        poses, covariances = self._problem.spaces.in_map(states, spread)
        absent = np.isnan(states).any(axis=-1)
        poses[absent], covariances[absent] = np.nan, np.nan
        return poses, covariances, existence


def _of_outliers(step: Step, expansion: Expansion) -> Array:
    """(K, D) probabilities that detections are geometric outliers of their objects; 0 for those that are not used."""
    found = np.zeros((len(expansion.ids), len(step.names)))
    if expansion.assignments.outlier_probability is not None:
        found[:, expansion.used] = expansion.assignments.outlier_probability
    return found


def _stacked(rows: list[Array], num_objects: int) -> Array:
    """Stack S tables (O, L) to (S, O, L); L is 0 if there is none."""
    return np.array(rows) if rows else np.zeros((0, num_objects, 0))


def _or_nan(column: Array | None, count: int) -> Array:
    """(count,) a column, NaN where the association strategy has none."""
    return np.full(count, np.nan) if column is None else column


def _rows(rows: list[tuple[int, ...]], width: int) -> NDArray[np.int32]:
    return np.array(rows, dtype=np.int32).reshape(len(rows), width)
