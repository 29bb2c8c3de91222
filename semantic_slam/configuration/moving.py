"""Objects that move while the robot drives."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class MovingConfiguration:
    share: float = parameter(
        0.0,
        "association: open with iterate_updates: false,"
        " semantic_model.kind: none, detector, embedding or detector_embedding: share of the objects"
        " that may move; 0: none does",
        minimum=0.0,
        maximum=0.9,
    )
    share_by_label: tuple[str, ...] = parameter(
        (), "that share by the detector's label, in place of share, whatever the case: [car=0.2, tree=0]"
    )
    speeds_m_s: tuple[float, ...] = parameter(
        (0.0, 0.5, 2.5, 12.0),
        "standard deviations of what may move along x and y, of which it has one; evidence decides; 0: it stands",
        distinct=True,
    )
    steadiness_s: float = parameter(
        10.0, "time after which a moving object's velocity is correlated by 1 / e", minimum=1e-3
    )
