"""Load balancing: which backend holds which surviving hypothesis."""

from collections import Counter
from collections.abc import Sequence

SHORT, EARLY_SLACK, SLACK = 3, 1.1, 1.75
"""A backend may hold this many times its fair share before children move to another one.

A move replays a lineage, which is cheap only while lineages are at most ``SHORT`` keyframes long: up to then the slack
is ``EARLY_SLACK``, afterwards ``SLACK``.
"""


def assign_owners(parents_owners: Sequence[int], backend_ids: Sequence[int], length: int) -> list[int]:
    """Owner of each survivor, heaviest first: its parent's owner while that has room, else the least loaded backend.

    ``length`` is that of the lineages, in keyframes.
    """
    slack = EARLY_SLACK if length <= SHORT else SLACK
    share = max(1, int(slack * len(parents_owners) / len(backend_ids)))
    load = Counter({backend: 0 for backend in backend_ids})
    owners = []
    for owner in parents_owners:
        if owner not in load or load[owner] >= share:
            owner = min(load, key=lambda backend: (load[backend], backend))
        load[owner] += 1
        owners.append(owner)
    return owners
