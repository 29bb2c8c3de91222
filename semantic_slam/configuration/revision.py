"""Looks back: objects that are one, returns to another object, and where a lost robot may be."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class RevisionConfiguration:
    every_keyframes: int = parameter(
        0,
        "association: open: keyframes from one look for objects that are one, in space also for those that are none, to"
        " the next; 0: never",
        minimum=0,
    )
    second_boxes_every_keyframes: int = parameter(
        0,
        "association: open with open_world.second_box_share, in the plane: keyframes from one look for objects that are"
        " none, but second boxes of things beside them, to the next; 0: never",
        minimum=0,
    )
    lost_every_keyframes: int = parameter(
        0,
        "association: open with a map, the initial pose wider than 1 m or 0.3 rad: keyframes from one look for where on"
        " the map the robot may be to the next; 0: never",
        minimum=0,
    )
    lost_hypotheses: int = parameter(
        0,
        "hypotheses that are followed of a robot that was lost so when it began, beside the looks for where it may be;"
        " 0: as pruning says",
        minimum=0,
        maximum=100_000,
    )
    carried_probability: float = parameter(
        0.0,
        "from one keyframe to the next, that the robot is lifted and set down elsewhere, of which odometry tells"
        " nothing; 0: it never is, and one that is carried is not found again",
        minimum=0.0,
        maximum=0.1,
    )
    carried_m: float = parameter(
        4.0, "standard deviation along x and y of where it is carried to, from where it was", minimum=1.0, maximum=16.0
    )
    proposals: int = parameter(
        4,
        "revised histories of each kind that are weighed in one look: objects that are one (in space two of these),"
        " that move, that stand, that are none",
        minimum=1,
    )
    splits: int = parameter(
        4,
        "returns to an object, likeliest first, that one look takes to have been to another one, in the plane; 0: none",
        minimum=0,
    )
    horizon: int = parameter(
        600,
        "keyframes up to which histories are revised: each revised one is replayed from the start,"
        " 25 keyframes of it in each",
        minimum=1,
    )
    reassociate_every_keyframes: int = parameter(
        0,
        "association: open with detection_errors.correlated_share, without a map, semantic_model.kind: none, detector,"
        " embedding or detector_embedding: beyond the horizon,"
        " keyframes from one look for places taken for others, or mapped twice, to the next; 0: never",
        minimum=0,
    )

    @property
    def is_on(self) -> bool:
        """Whether histories are revised, other than for a robot that is lost."""
        return self.every_keyframes > 0 or self.second_boxes_every_keyframes > 0
