"""What was tried already: a history that lost is not replayed again before there is something new to say for it."""

from collections.abc import Sequence

from semantic_slam.inference.revision.replay import Lineage

Group = tuple[int, ...]


class Tried:
    """Groups of objects that were tried together, and after which keyframe."""

    def __init__(self, patience: int) -> None:
        """``patience``: keyframes after which a group may be tried again, if one of its objects was seen since."""
        self._patience = patience
        self._when: dict[Group, int] = {}

    def note(self, groups: Sequence[Group], now: int) -> None:
        """Remember that groups are tried ``now``, after so many keyframes."""
        self._when |= dict.fromkeys(groups, now)

    def news(self, groups: Sequence[Group], lineage: Lineage) -> list[Group]:
        """Groups that were not tried, or long ago, and seen since by a history."""
        seen = last_seen(lineage)
        return [group for group in groups if self._is_news(group, seen, len(lineage))]

    def _is_news(self, group: Group, seen: dict[int, int], now: int) -> bool:
        when = self._when.get(group)
        if when is None:
            return True
        return now - when >= self._patience and max(seen.get(number, -1) for number in group) >= when


def last_seen(lineage: Lineage) -> dict[int, int]:
    """Object -> the keyframe at which it was detected last."""
    return {number: keyframe for keyframe, step in enumerate(lineage) for number in step.association}
