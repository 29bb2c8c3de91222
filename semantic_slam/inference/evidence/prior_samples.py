"""Evidence by samples from the prior: PROPWEIGHTS of Alg. 4.1, kept as the thesis's reference."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.importance import Samples, effective_share
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem


def sample_evidence(
    stack: KeyframeProblem, num_samples: int, generators: list[np.random.Generator]
) -> tuple[Array, Array]:
    """Log of psi (Eq. 4.20), with P(beta | x, O) as a hard test, and effective sample size; (B,) each.

    ``generators`` holds one generator per candidate, so that its draws depend on nothing but its own key. A
    candidate none of whose samples explains the measurements has log psi = -inf and an effective sample size of 0.
    """
    log_evidence, effective = np.empty(len(generators)), np.empty(len(generators))
    for row, random in enumerate(generators):
        repeated = stack.select(np.full(num_samples, row))
        y = random.standard_normal((num_samples, stack.size))
        log_weight = repeated.log_likelihood(y) + repeated.log_visibility(y, soft=False)
        log_evidence[row] = Samples(y, log_weight).part()[0]
        effective[row] = num_samples * effective_share(log_weight)
    return log_evidence, effective
