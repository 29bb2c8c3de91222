"""Session: one run of a hypothesis manager, from its first keyframe to its last; a manager has them in sequence."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import BackendPool, RunConfiguration
from semantic_slam.inference.relocation.carried_spans import Spans
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.first_label import FirstLabel
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.start import announced_run
from semantic_slam.pipeline.unmeant_labels import UnmeantLabels
from semantic_slam.state import restore, state_of

CHANGEABLE = ("keyframes.policy", "keyframes.distance_m", "keyframes.angle_rad", "open_world.time_budget_ms")
"""Parameters that may change during a run; all others are part of the model that its beliefs share."""
SOMETHING = ("object",)
"""Assumed labels of detections before any have been received."""


class Session:
    """Keyframes and beliefs of one run, which starts with its first keyframe."""

    STATE: ClassVar[tuple[str, ...]] = (
        "number",
        "map_prior",
        "num_keyframes",
        "assembler",
        "_configuration",
        "_first_label",
        "_unmeant",
        "_initial_pose",
        "_is_told_pose",
        "_next_pose",
        "_first",
    )

    def __init__(
        self,
        configuration: Configuration,
        map_prior: MapPrior | None,
        source: str,
        *,
        number: int = 0,
        initial_pose: PoseEstimate | None = None,
        imu: ImuSource | None = None,
    ) -> None:
        """``initial_pose``: start pose unless another is set before the first keyframe; None: as configured.

        ``imu``: source of the IMU readings passed to the assembler; None: there is none.
        """
        self.number, self.map_prior = number, map_prior
        self.num_keyframes = 0
        self._configuration, self._source = configuration, source
        self._first_label = FirstLabel(configuration.semantic_model)
        self.assembler = KeyframeAssembler(
            configuration,
            has_identities=strategy_of(configuration).wants_identities,
            passes_over=self._first_label.passes_over,
            imu=imu,
        )
        self._unmeant = UnmeantLabels(configuration)
        self._imu = imu
        self._initial_pose, self._is_told_pose = initial_pose, False
        self._next_pose: PoseEstimate | None = None
        self._first: Keyframe | None = None
        self._engine: Engine | None = None

    @property
    def configuration(self) -> Configuration:
        return self._configuration

    def check_change(self, changed: Configuration) -> None:
        """Raises InputError if values of :data:`CHANGEABLE` cannot change so during a run; may be called anytime."""
        before, after = (own.open_world.time_budget_ms for own in (self._configuration, changed))
        if (before > 0.0) != (after > 0.0):
            raise InputError(
                "open_world.time_budget_ms: whether there is a budget is decided at the start, since runs with one"
                " cannot be repeated; start again with it"
            )

    def change(self, changed: Configuration) -> None:
        """Use a configuration with other values of :data:`CHANGEABLE` from now on, also in the next sessions."""
        self._configuration = changed
        self.assembler.policy = changed.keyframes
        if self._engine is not None:
            self._engine.budget.set(changed.open_world.time_budget_ms)

    def set_initial_pose(self, estimate: PoseEstimate) -> None:
        """Set the start pose of this run; only the first call counts. A later pose becomes the next run's default."""
        if not self._is_told_pose and self._engine is None:
            self._initial_pose, self._is_told_pose = estimate, True
        else:
            self._next_pose = estimate

    @property
    def dropped(self) -> Counter[str]:
        """Counts of inputs not used and hypotheses dropped, by reason."""
        lost = self._engine.lost if self._engine is not None else Counter[str]()
        return self.assembler.dropped + self._unmeant.dropped + lost

    def news(self) -> list[str]:
        """Lines for the console, each once: labels that are left out of the run, and a region that does not fit."""
        return [*self.assembler.news(), *self._unmeant.news()]

    @property
    def run(self) -> RunConfiguration:
        """Configuration of the run. Raises InputError before the first keyframe."""
        if self._engine is None:
            raise InputError("there is no belief yet; ask after the first keyframe")
        return self._engine.run

    @property
    def carried(self) -> float:
        """Probability that the robot was kidnapped (carried elsewhere) during the last keyframes."""
        return self._engine.carried if self._engine is not None else 0.0

    @property
    def carried_spans(self) -> Spans:
        """Keyframes in which the robot was taken for carried elsewhere."""
        return self._engine.carried_spans.spans if self._engine is not None else ()

    @property
    def num_without_label(self) -> int:
        """Number of keyframes that wait for the first detection with a label."""
        return self._first_label.num_waiting

    def beliefs(self, pool: BackendPool, *, at_end: bool = False) -> Iterator[tuple[Keyframe, HybridBelief]]:
        """Keyframes that are complete, or ``at_end`` all remaining ones, each with the belief after it."""
        found = self.assembler.flush() if at_end else self.assembler.take()
        for keyframe in self._first_label.released(found, at_end=at_end):
            if self._engine is None:
                self._first = keyframe
                self._engine = Engine.of_run(self._run(keyframe, self.map_prior, self._first_label.labels), pool)
            else:
                keyframe = self._unmeant.without(keyframe)
            belief = self._engine.process(keyframe)
            self.num_keyframes += 1
            yield keyframe, belief

    @property
    def may_be_stored(self) -> bool:
        """Whether :meth:`state` is all that the session needs."""
        return self._engine is not None and self._engine.may_be_stored

    def state(self) -> dict[str, Any]:
        """The state of the session and its engine. Raises InputError before the first keyframe."""
        if self._engine is None:
            raise InputError("there is no belief yet; ask after the first keyframe")
        return {"own": state_of(self), "run": self._engine.run, "engine": self._engine.state()}

    def restore(self, state: dict[str, Any], pool: BackendPool) -> None:
        """Go on from a state of a session of the same configuration. Raises ValueError or KeyError for any other."""
        restore(self, state["own"])
        self._engine = Engine.of_run(state["run"], pool)
        self._engine.restore(state["engine"])

    def follower(self, map_prior: MapPrior | None) -> "Session":
        """The next session, on ``map_prior``; it takes over the settings and a pose set for the next run."""
        pose, number = self._next_pose, self.number + 1
        return Session(self._configuration, map_prior, self._source, number=number, initial_pose=pose, imu=self._imu)

    def check(self, map_prior: MapPrior) -> None:
        """Raises InputError if a run with detections like those of this one cannot start on the map.

        Before the first keyframe their labels are unknown; ``perception.labels`` or else :data:`SOMETHING` is assumed.
        """
        first, labels = self._first, self._first_label.labels
        if first is None:
            first, labels = Keyframe.planar(0), frozenset(self._configuration.perception.labels or SOMETHING)
        problem_of(self._run(first, map_prior, labels))

    def _run(self, first: Keyframe, map_prior: MapPrior | None, labels: Iterable[str]) -> RunConfiguration:
        return announced_run(
            self._configuration,
            map_prior,
            self._initial_pose,
            first,
            labels=labels,
            source=self._source,
            session=self.number,
        )
