"""Which backend holds which survivor."""

from collections import Counter
from collections.abc import Sequence

SLACK = 1.5
"""A backend may hold this many times its fair share before children move: a move replays a lineage."""


def assign_owners(parents_owners: Sequence[int], backend_ids: Sequence[int]) -> list[int]:
    """Owner of each survivor, heaviest first: its parent's while that one has room, else the least loaded."""
    share = max(1, int(SLACK * len(parents_owners) / len(backend_ids)))
    load = Counter({backend: 0 for backend in backend_ids})
    owners = []
    for owner in parents_owners:
        if owner not in load or load[owner] >= share:
            owner = min(load, key=lambda backend: (load[backend], backend))
        load[owner] += 1
        owners.append(owner)
    return owners
