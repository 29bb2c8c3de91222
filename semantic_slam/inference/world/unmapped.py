"""Placeholders for objects that the map may lack: map entries with a broad prior and a small existence probability.

An object that is missing in the map is detected again and again at one place. Explained as clutter (false alarms), each
detection would cost a history, and a lost robot whose first views are of such an object would be localised wrongly.
"""

import numpy as np

from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

SURELY = float(np.nextafter(1.0, 0.0))
"""Largest existence probability of a placeholder that is not detected yet, which tells it from those that are."""


def unmapped_objects(
    prior: MapPrior, count: int, probability: float, reach_m: float, sigma_heading_rad: float
) -> tuple[ObjectPrior, ...]:
    """Make ``count`` placeholder objects beside those of ``prior``, each of existence ``probability``.

    Their position prior is centred on the mapped objects; its variance is that of their positions, plus the square of
    half of ``reach_m``, the sensor's range.
    """
    if not count:
        return ()
    places = np.array([item.pose[:2] for item in prior.objects])
    centre, sigma = places.mean(axis=0), float(np.sqrt(places.var(axis=0).mean() + 0.25 * reach_m**2))
    first = 1 + max(item.object_id for item in prior.objects)
    return tuple(
        ObjectPrior.planar(
            number,
            *centre.tolist(),
            sigma_m=sigma,
            sigma_rad=sigma_heading_rad,
            name=f"unmapped_{number}",
            existence=min(probability, SURELY),
        )
        for number in range(first, first + count)
    )
