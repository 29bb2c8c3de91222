"""The frame that chapter 5's results share: numbers of both formulations, and of the shipped model in rooms."""

from collections.abc import Mapping
from typing import Any

from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, WORDS
from semantic_slam_lab.studies.result import Table

Numbers = Mapping[str, Mapping[str, float]]
"""Model, by its name in ``WORDS`` -> metric -> value; every model has the metrics of the default."""


def framed(study: str, numbers: Numbers, config: Mapping[str, Any], *, quick: bool, seed: int) -> dict[str, Any]:
    """What result.json holds, but for the claims."""
    from semantic_slam.pipeline.provenance import revision

    return {
        "study": study,
        "seed": seed,
        "config": dict(config),
        "revision": revision(),
        "quick": quick,
        "formulations": {name: numbers[name] for name in FORMULATIONS},
        "summary": numbers[DEFAULT],
    }


def numbers_table(title: str, numbers: Numbers) -> Table:
    """A row for each model."""
    columns = tuple(numbers[DEFAULT])
    rows = tuple((WORDS[name], *(f"{row[column]:.3g}" for column in columns)) for name, row in numbers.items())
    return Table(title, ("model", *(column.replace("_", " ") for column in columns)), rows)
