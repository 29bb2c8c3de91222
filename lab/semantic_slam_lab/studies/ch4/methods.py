"""Which engines and worlds the statistics of chapter 4 compare, and their names on the page."""

from collections.abc import Mapping
from typing import Any

from semantic_slam_lab.studies.ch4.runs import Method

DEFAULT_ALPHA = 0.25
ALPHAS = (0.05, DEFAULT_ALPHA, 0.5, 0.75, 1.0)
WITH = tuple(Method(alpha) for alpha in ALPHAS)
WITHOUT, OURS = Method(None), Method(DEFAULT_ALPHA)
SAMPLED = Method(DEFAULT_ALPHA, weights="sampled")
VARIANTS = {
    SAMPLED: "the thesis's 1000 samples",
    Method(DEFAULT_ALPHA, weights="laplace"): "Laplace weights alone",
}
"""Weights that differ from the default, in words."""
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
FIGURE = {
    "association_entropy": "H(associations) [nats]",
    "component_entropy": "H(components) [nats]",
    "det_position_covariance": "det Sigma [m⁴]",
    "error_max_weight_m": "error, max weight [m]",
    "error_weighted_m": "error, weighted [m]",
    "num_hypotheses": "hypotheses",
    "seconds_per_keyframe": "s per keyframe",
}
ASSOCIATIONS = {
    "p_true_association_final": "P(true association), at the end",
    "p_true_association_least": "least of the runs",
    "confidence": "largest P of an association",
    "likeliest_is_true": "it is the true one",
    "runs_lost": "runs lost",
    "truth_lost": "truth pruned",
    "discarded_mass_final": "mass discarded on the way",
}
COLUMNS = {"averages over runs and keyframes (Fig. 4.5)": FIGURE, "associations": ASSOCIATIONS}
"""Title of a table -> metric -> its column."""
Summaries = Mapping[str, Mapping[str, Any]]
"""Method's name -> its averages."""


def words(name: str) -> str:
    """A method's name as a page shows it."""
    if name == WITHOUT.name:
        return "without semantics (DA-BSP)"
    of_variants = {method.name: f"alpha {method.alpha}, {difference}" for method, difference in VARIANTS.items()}
    return of_variants.get(name, f"alpha {name}")
