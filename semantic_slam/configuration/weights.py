"""How the evidence of a candidate is computed, and which candidates are weighed at all."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class WeightsConfiguration:
    method: str = parameter(
        "importance",
        "evidence of a candidate: damped Laplace with importance samples, damped Laplace alone, or prior samples",
        choices=("importance", "laplace", "sampled"),
    )
    num_samples: int = parameter(1000, "sampled: prior samples per candidate (the thesis's 1000)", minimum=1)
    importance_samples: int = parameter(
        1024,
        "importance: samples of a candidate whose history is not Gaussian, drawn at a time: a quarter where those"
        " suffice, up to four times as many where they are drawn anew, nearer to its posterior",
        minimum=16,
    )
    screening_samples: int = parameter(
        64, "importance: samples that tell whether a candidate is Gaussian; 16 where that is clear", minimum=16
    )
    importance_gate: float = parameter(
        7.0,
        "importance: nats below the best candidate of its parent at which one is not sampled; .inf: all are",
        minimum=0.0,
        infinite=True,
    )
    gaussian_share: float = parameter(
        0.95,
        "importance: effective share of samples from which on a hypothesis counts as Gaussian",
        minimum=0.0,
        maximum=1.0,
    )
    max_history: int = parameter(
        6,
        "importance: longest window, in keyframes, whose evidence is sampled anew while a hypothesis is not Gaussian",
        minimum=1,
    )
    gate: float = parameter(
        15.0,
        "nats below the best of its parent at which an association or a class is not followed any more; .inf: all are",
        minimum=0.0,
        infinite=True,
    )
    max_candidates: int = parameter(400, "candidates weighed per parent and keyframe", minimum=1)
    max_associations: int = parameter(
        2000,
        "detections in all candidates of one parent and keyframe: where there are many detections, there are fewer"
        " candidates, and what is left out counts in discarded_mass; 0: no limit",
        minimum=0,
    )
    bagged_sets: int = parameter(
        0,
        "with pruning.place_m: resampled sets of keyframes over which a belief's weights are averaged between places of"
        " the robot, where models are not exact; 0: weights as they are",
        minimum=0,
        maximum=10_000,
    )
