"""When the poses of long ago are summarised, and which."""

from semantic_slam.configuration import Configuration, HistoryConfiguration
from semantic_slam.errors import InputError

SHARE = 4
"""A summary comes once in so many parts of the horizon: it costs as much as some updates."""
LEAST = 20
"""Shortest horizon, keyframes."""
ASK_OLD_POSES = ("gp_correlated", "latent")
"""Class models whose views are weighed anew together with those of long ago, at the poses of these."""


def check_horizon(configuration: Configuration) -> None:
    """Raises InputError where poses would be summarised that something else asks for."""
    horizon, revision = configuration.history.horizon_keyframes, configuration.revision
    if horizon == 0:
        return
    least = max(LEAST, 2 * configuration.weights.max_history)
    if horizon < least:
        raise InputError(f"history.horizon_keyframes is {horizon}; set it to {least} or more, or to 0: all poses stay")
    revises = revision.is_on or revision.lost_every_keyframes > 0
    if configuration.association == "open" and revises and horizon < revision.horizon:
        raise InputError(
            f"history.horizon_keyframes is {horizon}: histories are revised up to keyframe {revision.horizon};"
            " set it to revision.horizon or more"
        )
    if revision.carried_probability > 0.0:
        raise InputError(
            "history.horizon_keyframes is not for a robot that may be carried, of which all keyframes are replayed;"
            " set revision.carried_probability: 0, or the horizon to 0"
        )
    if configuration.semantic_model.kind in ASK_OLD_POSES:
        raise InputError(
            f"history.horizon_keyframes: semantic_model.kind {configuration.semantic_model.kind} weighs views at poses"
            " of long ago; set the horizon to 0, or another kind"
        )
    if configuration.detection_errors.correlated_share > 0.0:
        raise InputError(
            "history.horizon_keyframes is not for detection_errors.correlated_share above 0; set one of them to 0"
        )


def apart(settings: HistoryConfiguration) -> int:
    """Keyframes from one summary to the next."""
    return max(settings.horizon_keyframes // SHARE, 1)


def oldest_kept(settings: HistoryConfiguration, keyframe: int) -> int | None:
    """The keyframe from which on poses stay, after a ``keyframe`` that summarises; None: it does not."""
    horizon, count = settings.horizon_keyframes, keyframe + 1
    if horizon == 0 or count % apart(settings) or count < horizon + apart(settings):
        return None
    return count - horizon
