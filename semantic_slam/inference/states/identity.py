"""Content-based identity: ids of hypotheses and runs, and seeds of random generators, as digests.

With counters or Python's salted ``hash`` a belief would depend on the number of processes.
"""

import hashlib
import struct
from collections.abc import Sequence
from itertools import chain

import numpy as np

ROOT_ID = 0
"""Id of the hypothesis before any measurement."""


def hypothesis_id(
    parent_id: int,
    stamp_ns: int,
    association: Sequence[int],
    class_assignment: Sequence[int],
    mode: int,
    changes: Sequence[Sequence[int]] = (),
) -> int:
    """64-bit digest of a hypothesis's parent, keyframe stamp, association, class assignment, mode and changes."""
    count, changed = len(association), list(chain.from_iterable(changes))
    layout = f"<QqI{count}i{count}i{'H' if mode < 2**16 else 'I'}{len(changed)}i"
    packed = struct.pack(layout, parent_id, stamp_ns, count, *association, *class_assignment, mode, *changed)
    return int.from_bytes(hashlib.blake2b(packed, digest_size=8).digest(), "little")


def digest(*parts: str) -> str:
    """Hexadecimal digest of texts, each delimited."""
    state = hashlib.blake2b(digest_size=8)
    for part in parts:
        encoded = part.encode()
        state.update(struct.pack("<Q", len(encoded)) + encoded)
    return state.hexdigest()


def generator(seed: int, purpose: str, stamp_ns: int, key: int) -> np.random.Generator:
    """Random generator keyed by (seed, purpose, stamp, id)."""
    packed = struct.pack("<qqQ", seed, stamp_ns, key) + purpose.encode()
    return np.random.default_rng(int.from_bytes(hashlib.blake2b(packed, digest_size=16).digest(), "little"))
