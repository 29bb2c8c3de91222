"""Opens the journal of a hypothesis manager for its run."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.pipeline.journal.journal import Journal, NoJournal, to_stderr
from semantic_slam.version import __version__


def open_journal(
    folder: str,
    configuration: Configuration,
    map_prior: MapPrior | None,
    source: str,
    *,
    resume: bool,
    say: Callable[[str], None] = to_stderr,
) -> NoJournal:
    """Open the journal in a folder; "" gives a null journal. ``say`` is called with a line on what is damaged.

    Raises InputError if it belongs to a run with another configuration, map, input or version, or if the run cannot be
    repeated.
    """
    if not folder:
        return NoJournal()
    if configuration.open_world.time_budget_ms > 0.0:
        raise InputError(
            "parameter journal: with open_world.time_budget_ms a run cannot be repeated; set one or the other"
        )
    prior = "" if map_prior is None else map_prior.to_json()
    run = {
        "configuration": to_dict(configuration),
        "map_prior": hashlib.sha256(prior.encode()).hexdigest(),
        "source": source,
        "version": __version__,
    }
    return Journal(Path(folder), json.dumps(run, sort_keys=True), resume=resume, say=say)
