"""Fixed-lag schedule: when old poses are marginalised (summarised), and which."""

from semantic_slam.configuration import HistoryConfiguration

SHARE = 4
"""Marginalisations per horizon: one costs as much as several updates."""


def apart(settings: HistoryConfiguration) -> int:
    """Keyframes between marginalisations."""
    return max(settings.horizon_keyframes // SHARE, 1)


def oldest_kept(settings: HistoryConfiguration, keyframe: int) -> int | None:
    """The keyframe from which on poses are kept, after a ``keyframe`` at which to marginalise; None: it is not one."""
    horizon, count = settings.horizon_keyframes, keyframe + 1
    if horizon == 0 or count % apart(settings) or count < horizon + apart(settings):
        return None
    return count - horizon
