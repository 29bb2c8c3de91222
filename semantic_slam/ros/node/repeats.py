"""Detection of repeated messages: a lossless replay that resumes after a crash sends some messages again.

Live inputs do not repeat and are not checked.
"""

from collections import Counter, deque
from hashlib import blake2b
from typing import ClassVar

from semantic_slam.messages import topics

MOST_REMEMBERED = 20_000
"""Messages remembered per topic: more than a late subscriber's history holds, or a resumed replay sends again."""
MOST_NEWS = 1000
"""Messages remembered per progress topic, which are latched: a late subscriber gets only the last one."""
DIGEST_SIZE = 8
NEWS = frozenset({topics.CLASSIFIER_PROGRESS, topics.MANAGER_PROGRESS})


class Repeats:
    """Recognises repeated messages of each topic by a hash of their bytes; ``counted`` counts them by topic."""

    STATE: ClassVar[tuple[str, ...]] = ("_digests",)

    def __init__(self, counted: Counter[str]) -> None:
        self._counted = counted
        self._known: dict[str, set[bytes]] = {}
        self._order: dict[str, deque[bytes]] = {}

    @property
    def _digests(self) -> dict[str, bytes]:
        """The known messages' hashes by topic, in order."""
        return {topic: b"".join(order) for topic, order in self._order.items()}

    @_digests.setter
    def _digests(self, digests: dict[str, bytes]) -> None:
        self._order = {
            topic: deque(every[at : at + DIGEST_SIZE] for at in range(0, len(every), DIGEST_SIZE))
            for topic, every in digests.items()
        }
        self._known = {topic: set(order) for topic, order in self._order.items()}

    def is_known(self, topic: str, data: bytes) -> bool:
        """Whether the topic had this message before; remembers it."""
        known, order = self._known.setdefault(topic, set()), self._order.setdefault(topic, deque())
        digest = blake2b(data, digest_size=DIGEST_SIZE).digest()
        if digest in known:
            self._counted[topic] += 1
            return True
        known.add(digest)
        order.append(digest)
        if len(order) > (MOST_NEWS if topic in NEWS else MOST_REMEMBERED):
            known.discard(order.popleft())
        return False

    def forget(self, topic: str, data: bytes) -> None:
        """Forget a message that was not used, so that it is accepted when it arrives again."""
        digest = blake2b(data, digest_size=DIGEST_SIZE).digest()
        if digest in self._known.get(topic, ()):
            self._known[topic].remove(digest)
            self._order[topic].remove(digest)
