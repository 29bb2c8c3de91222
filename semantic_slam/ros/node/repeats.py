"""Messages that come again: a lossless replay that goes on after a death goes over what it had sent.

Live inputs never repeat, and are not looked at.
"""

from collections import Counter, deque
from hashlib import blake2b

from semantic_slam.messages import topics

MOST_REMEMBERED = 20_000
"""Messages of a topic that are remembered: more than a late reader is sent again, or a replay goes back."""
MOST_NEWS = 1000
"""Messages of how far another node is that are remembered: a late reader is sent the last one alone."""
NEWS = frozenset({topics.CLASSIFIER_PROGRESS, topics.MANAGER_PROGRESS})


class Repeats:
    """Knows the messages of each topic by their bytes; ``counted`` counts, by topic, those that came again."""

    def __init__(self, counted: Counter[str]) -> None:
        self._counted = counted
        self._known: dict[str, set[bytes]] = {}
        self._order: dict[str, deque[bytes]] = {}

    def is_known(self, topic: str, data: bytes) -> bool:
        """Whether the topic had this message before; from now on it has."""
        known, order = self._known.setdefault(topic, set()), self._order.setdefault(topic, deque())
        digest = blake2b(data, digest_size=8).digest()
        if digest in known:
            self._counted[topic] += 1
            return True
        known.add(digest)
        order.append(digest)
        if len(order) > (MOST_NEWS if topic in NEWS else MOST_REMEMBERED):
            known.discard(order.popleft())
        return False

    def forget(self, topic: str, data: bytes) -> None:
        """Take a message for one that the topic never had: it was not used, and may come again in its turn."""
        digest = blake2b(data, digest_size=8).digest()
        if digest in self._known.get(topic, ()):
            self._known[topic].remove(digest)
            self._order[topic].remove(digest)
