"""Which engines and worlds the statistics of chapter 4 compare, and their names on the page."""

from collections.abc import Mapping
from typing import Any

from semantic_slam.studies.ch4_runs import Method

DEFAULT_ALPHA = 0.25
ALPHAS = (0.05, DEFAULT_ALPHA, 0.5, 0.75, 1.0)
WITH = tuple(Method(alpha) for alpha in ALPHAS)
WITHOUT, OURS = Method(None), Method(DEFAULT_ALPHA)
SAMPLED = Method(DEFAULT_ALPHA, weights="sampled")
OTHERS = {
    SAMPLED: "the thesis's 1000 samples",
    Method(DEFAULT_ALPHA, weights="laplace"): "Laplace weights alone",
    Method(DEFAULT_ALPHA, pruning_ratio=150.0): "pruned below max / 150",
    Method(DEFAULT_ALPHA, pruning_ratio=1e4): "pruned below max / 10 000",
}
"""What differs from the default in weights or pruning, in words; one of them may be the default."""
VARIANTS = tuple(method for method in OTHERS if method != OURS)
WORLDS = {
    "given": "given layout, errors of the map drawn from its prior",
    "exact_map": "given layout, every object exactly where the map has it",
    "random": "random layouts, errors of the map and the start drawn from their priors",
}
METHODS_OF = {
    "given": (*WITH, WITHOUT, *VARIANTS),
    "exact_map": (OURS, WITHOUT, SAMPLED),
    "random": (OURS, WITHOUT, SAMPLED),
}
COLUMNS = {
    "association_entropy": "H(associations) [nats]",
    "component_entropy": "H(components) [nats]",
    "det_position_covariance": "det Sigma [m^4]",
    "error_max_weight_m": "error, max weight [m]",
    "error_weighted_m": "error, weighted [m]",
    "num_hypotheses": "hypotheses",
    "p_true_association_final": "P(true association), final",
    "confidence": "largest P",
    "likeliest_is_true": "it is the true one",
    "runs_lost": "runs lost",
    "truth_lost": "truth pruned",
    "discarded_mass": "discarded mass",
    "seconds_per_keyframe": "s per keyframe",
}
Summaries = Mapping[str, Mapping[str, Any]]
"""Method's name -> its averages."""


def words(name: str) -> str:
    """A method's name as a page shows it."""
    if name == WITHOUT.name:
        return "without semantics (DA-BSP)"
    of_variants = {method.name: f"alpha {method.alpha}, {OTHERS[method]}" for method in VARIANTS}
    return of_variants.get(name, f"alpha {name}")
