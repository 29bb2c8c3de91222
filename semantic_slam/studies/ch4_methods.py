"""Which engines and worlds the statistics of chapter 4 compare, and their names on the page."""

from collections.abc import Mapping
from typing import Any

from semantic_slam.studies.ch4_runs import Method

DEFAULT_ALPHA = 0.25
ALPHAS = (0.05, DEFAULT_ALPHA, 0.5, 0.75, 1.0)
THESIS_PRUNING, PATIENT_PRUNING = 150.0, 1e4
WITH = tuple(Method(alpha) for alpha in ALPHAS)
WITHOUT = Method(None)
OURS, SAMPLED = Method(DEFAULT_ALPHA), Method(DEFAULT_ALPHA, sampled=True)
PRUNED = tuple(
    method
    for method in (Method(DEFAULT_ALPHA, pruning_ratio=ratio) for ratio in (THESIS_PRUNING, PATIENT_PRUNING))
    if method != OURS
)
"""Without the one that is the default."""
METHODS = (*WITH, WITHOUT, SAMPLED, *PRUNED)
WORLDS = {
    "given": "given layout, errors of the map drawn from its prior",
    "exact_map": "given layout, every object exactly where the map has it",
    "random": "random layouts, errors of the map and the start drawn from their priors",
}
FEW = (OURS, WITHOUT, SAMPLED, *PRUNED)
METHODS_OF = {"given": METHODS, "exact_map": FEW, "random": FEW}
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
    special = {
        WITHOUT.name: "without semantics (DA-BSP)",
        SAMPLED.name: f"alpha {DEFAULT_ALPHA}, the thesis's 1000 samples",
        **{m.name: f"alpha {DEFAULT_ALPHA}, pruned below max / {m.pruning_ratio:g}" for m in PRUNED},
    }
    return special.get(name, f"alpha {name}")
