"""Loading of the extractor from a latent model file (store.py reads the rest, without torch)."""

from pathlib import Path

import torch

from semantic_slam.errors import InputError, one_line
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.latent.store import FORMAT, REMEDY

PREFIX = "extractor."


def read_extractor(path: Path) -> FeatureExtractor:
    """Load the extractor of a latent model file, ready to use. Raises InputError naming file, fault and remedy.

    Sets torch to one thread from here on: two threads that share a core are many times slower than one.
    """
    torch.set_num_threads(1)
    arrays, _ = FORMAT.read(path)
    state = {
        name.removeprefix(PREFIX): torch.from_numpy(value) for name, value in arrays.items() if name.startswith(PREFIX)
    }
    try:
        extractor = FeatureExtractor(len(state["head.bias"]))
        extractor.load_state_dict(state, strict=True)
    except (KeyError, RuntimeError, TypeError) as fault:
        reason = one_line(fault, 300)
        raise InputError(f"{path}: the extractor's weights do not fit ({reason}); {REMEDY}") from None
    extractor.eval()
    extractor.requires_grad_(False)
    return extractor
