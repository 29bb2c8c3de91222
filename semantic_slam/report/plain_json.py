"""Values as JSON can hold them."""

import json
import math
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """``value`` with arrays as lists and numbers as Python's; what is not finite becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def to_text(value: Any) -> str:
    """JSON text of ``value`` through :func:`plain`."""
    return json.dumps(plain(value), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
