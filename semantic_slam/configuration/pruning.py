"""Which hypotheses are kept (Sec. 4.4)."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class PruningConfiguration:
    ratio: float = parameter(
        150.0, "a hypothesis is kept from max weight / ratio on (Sec. 4.4)", minimum=1.0, maximum=1e300
    )
    max_hypotheses: int = parameter(60, "hypotheses kept at most", minimum=1)
    max_poses: int = parameter(
        0,
        "keyframes so far times hypotheses kept, at most: a keyframe costs what all their poses do, so that fewer are"
        " followed in a long drive, one at least; 0: as many as ever",
        minimum=0,
    )
    place_m: float = parameter(
        0.0,
        "hypotheses whose robots are nearer to each other, and that began under the same noise, are of one kind. Half"
        " of max_hypotheses is dealt out to the kinds in turn, so that many variants of one place do not displace"
        " another; 0: all are of one kind",
        minimum=0.0,
    )
    max_pairs: int = parameter(
        0,
        "needs place_m: hypotheses of a kind kept times detections of the keyframe, at most: where much is in sight"
        " those of a kind differ by single associations, and a few have nearly all the weight; 0: as many as ever",
        minimum=0,
    )
    kind_ratio: float = parameter(
        1e6,
        "place_m: a kind is kept from max weight / kind_ratio on, and of it what weighs its heaviest / ratio;"
        " revision.carried_probability: so is the likeliest history that was not carried lately",
        minimum=1.0,
        maximum=1e300,
    )
