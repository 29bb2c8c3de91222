"""Memory of proposals: a rejected history is not replayed again before there is new evidence for it."""

from collections.abc import Sequence

from semantic_slam.inference.states.lineage import Lineage

Group = tuple[int, ...]


class Tried:
    """Groups of objects that were proposed together, with the keyframe at which they were."""

    def __init__(self, patience: int) -> None:
        """``patience``: keyframes after which a group may be tried again, if one of its objects was seen since."""
        self._patience = patience
        self._when: dict[Group, int] = {}

    def note(self, groups: Sequence[Group], now: int) -> None:
        """Record that the groups were tried at ``now``, a number of keyframes."""
        self._when |= dict.fromkeys(groups, now)

    def news(self, groups: Sequence[Group], lineage: Lineage) -> list[Group]:
        """Groups not tried yet, or tried at least ``patience`` keyframes ago and with an object seen since."""
        seen = last_seen(lineage)
        return [group for group in groups if self._is_news(group, seen, len(lineage))]

    def _is_news(self, group: Group, seen: dict[int, int], now: int) -> bool:
        when = self._when.get(group)
        if when is None:
            return True
        return now - when >= self._patience and max(seen.get(number, -1) for number in group) >= when


def last_seen(lineage: Lineage) -> dict[int, int]:
    """Object id -> the keyframe at which it was detected last."""
    return {number: keyframe for keyframe, step in enumerate(lineage) for number in step.association}
