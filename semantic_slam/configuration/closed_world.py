"""What a known map may lack or have wrong: clutter, unmapped and displaced objects, wrong identities."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class ClosedWorldConfiguration:
    clutter_per_frame: float = parameter(
        0.02,
        "enumerated: detections expected in a frame of nothing that the map has, even over open_world's region;"
        " 0: every detection is of an object of the map",
        minimum=0.0,
    )
    unmapped_objects: int = parameter(
        0,
        "enumerated, where clutter_per_frame is above 0: objects that the map may lack, each somewhere about it and of"
        " any class; once seen, such an object stays",
        minimum=0,
        maximum=8,
    )
    unmapped_probability: float = parameter(
        0.1, "probability of each unmapped object before the drive", minimum=1e-9, maximum=1.0
    )
    displaced_share: float = parameter(
        0.0,
        "enumerated, and given with iterate_updates: share of the map's objects that were moved since the map was made;"
        " above 0: the belief says which (moved), and these pull no pose",
        minimum=0.0,
        maximum=0.5,
    )
    displaced_sigma_m: float = parameter(
        1.0, "standard deviation along x and along y of how far these were moved", minimum=1e-3
    )
    wrong_identity_share: float = parameter(
        0.005,
        "given: share of identities that are wrong, their detections being of no object; 0: none is",
        minimum=0.0,
        maximum=0.5,
    )
