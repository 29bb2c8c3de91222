"""Second boxes of what is known already: a detector draws one thing in two halves, or two that stand together as one.

Of an object that it detects a detector gives a second box with a probability ``second_box_share``, whose place is
Gaussian about the object's, ``second_box_m`` to each side: false alarms that are not even, but stand beside things.
"""

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.open_world.births import Birth
from semantic_slam.inference.open_world.nearby import tracked_states
from semantic_slam.inference.smoothing.component import Component


def second_boxes(
    settings: OpenWorldConfiguration, component: Component, births: list[Birth], detected: Array
) -> tuple[Array, Array]:
    """(G,) second boxes expected in a frame, and (D, G) their intensities [1/m^2] where its detections lie.

    ``detected`` (O, G) are the detection probabilities of the component's objects.
    """
    chances = settings.second_box_share * component.objects.existence_given * detected
    expected = chances.sum(axis=0)
    if settings.second_box_share <= 0.0 or not births:
        return expected, np.zeros((len(births), len(expected)))
    tracked = tracked_states(component)
    places = np.array([born.prior.mean[:2] for born in births])
    noise = np.array([0.5 * np.trace(born.noise[:2, :2]) for born in births])
    variances = settings.second_box_m**2 + noise[:, None] + tracked.sigmas**2  # (D, O)
    squared = ((places[:, None] - tracked.states[:, :2]) ** 2).sum(axis=-1)
    return expected, np.exp(-0.5 * squared / variances) / (2.0 * np.pi * variances) @ chances
