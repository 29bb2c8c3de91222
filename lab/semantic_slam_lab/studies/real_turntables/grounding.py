"""Classes from two tagged objects each (Sec. 5.6.A), where it is known what the photographs show."""

import json
from importlib.resources import files
from pathlib import Path

import numpy as np

from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.turntables import read_classes
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.ch5.grounding import METHODS, TAGGED, judged
from semantic_slam_lab.studies.real_turntables.photographs import FOLDER

CLASSES_FILE = "classes.json"
"""{object: class} beside the photographs; COIL-100's objects are known, as far as they were looked at."""
DRAWS, QUICK_DRAWS = 20, 2


def classes_of(data: Path, names: tuple[str, ...]) -> dict[str, str]:
    """Classes with an object more than is tagged, {object: class}; raises InputError for an unreadable file."""
    file = next((path for path in (data / FOLDER / CLASSES_FILE, data / CLASSES_FILE) if path.is_file()), None)
    text = files(__package__).joinpath("coil100_classes.json").read_text(encoding="utf-8")
    classes = read_classes(file) if file else json.loads(text)
    own = {name: classes[name] for name in names if name in classes}
    return {name: kind for name, kind in own.items() if list(own.values()).count(kind) > TAGGED}


def grounded(
    model: LatentModel, views: FeatureViews, classes: dict[str, str], draws: int, seed: int
) -> dict[str, float]:
    """Mean accuracy of every method over draws of tags; ``views`` are of the objects in ``classes``."""
    if len(set(classes.values())) < 2:
        return {}
    drawn = [
        judged(model, views, keyed_generator("real_turntables", "tags", seed, n), classes.__getitem__)
        for n in range(draws)
    ]
    return {name: float(np.mean([accuracy[name] for accuracy in drawn])) for name in METHODS}
