"""What a horizon asks of the other settings, as old poses are marginalised beyond it."""

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.world.carried import SOON

LEAST = 20
"""Shortest horizon [keyframes]."""
ASK_OLD_POSES = ("gp_correlated", "latent")
"""Class models that evaluate views jointly with old ones, at the old poses."""


def check_horizon(configuration: Configuration) -> None:
    """Raises InputError where marginalised poses would still be needed by another setting."""
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
    if revision.carried_probability > 0.0 and horizon < SOON:
        raise InputError(
            f"history.horizon_keyframes is {horizon}: a robot that was carried is searched for over {SOON} keyframes;"
            f" set it to {SOON} or more, or revision.carried_probability: 0"
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
