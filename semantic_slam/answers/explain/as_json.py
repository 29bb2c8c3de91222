"""An explanation as JSON-compatible values at full precision; NaN and infinities as None."""

from typing import Any

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, HistoryExplained
from semantic_slam.answers.explain.ledger import ClassLedger

SCHEMA_VERSION = 1


def as_json(explanation: Explanation) -> dict[str, Any]:
    """Belief in the object, and its composition per history: the most likely class against every other."""
    return {
        "schema_version": SCHEMA_VERSION,
        "object": explanation.object_id,
        "name": explanation.name,
        "class_names": list(explanation.belief.class_names),
        "class_probabilities": explanation.belief.class_probabilities[explanation.row].tolist(),
        "largest_difference_nats": explanation.run.largest_difference,
        "histories": [_history(explanation, own) for own in explanation.histories],
    }


def _history(explanation: Explanation, own: HistoryExplained) -> dict[str, Any]:
    ledger = own.ledger
    posterior = ledger.log_posterior
    best = int(np.argmax(posterior)) if len(posterior) else -1
    others = [cls for cls in range(len(posterior)) if cls != best]
    keyframes = [keyframe.belief.keyframe for keyframe in explanation.run.keyframes]
    return {
        "weight": own.weight,
        "class_probabilities": np.exp(posterior).tolist(),
        "views": [_finite(vars(view)) for view in own.views],
        "pairs": [_pair(explanation, ledger, keyframes, best, other) for other in others],
        "rivals": [_finite(vars(rival)) for rival in own.rivals],
    }


def _pair(explanation: Explanation, ledger: ClassLedger, keyframes: list[int], best: int, other: int) -> dict[str, Any]:
    """``prior`` + the sum of ``nats`` + ``revised`` = ``log_odds``, in the belief of keyframe ``until``."""
    pair, names = ledger.pair(best, other), explanation.belief.class_names
    rows = np.flatnonzero(ledger.is_view & np.isfinite(pair.views))
    return _finite(
        {
            "classes": [names[best], names[other]],
            "prior": pair.prior,
            "nats": {str(keyframes[row]): float(pair.views[row]) for row in rows},
            "revised": pair.revised,
            "log_odds": pair.log_odds,
            "until": keyframes[pair.until] if pair.until >= 0 else None,
            "given_up": keyframes[pair.until + 1] if pair.is_pruned else None,
            "given_up_at": pair.gone,
        }
    )


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value for name, value in values.items()
    }
