"""Objects that a map may lack: each is one more object of the map, with hardly any prior, that may not exist.

An object that a map lacks shows again and again at one place. As false alarms its detections would cost a history as
much as so many false alarms, and a lost robot whose first views are of such an object would be taken elsewhere.
"""

import numpy as np

from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior


def unmapped_objects(
    prior: MapPrior, count: int, probability: float, reach_m: float, sigma_heading_rad: float
) -> tuple[ObjectPrior, ...]:
    """``count`` objects beside those of ``prior``, each of existence ``probability``.

    Their places have the moments of the map's, as far about them as ``reach_m``, half of it being a standard deviation.
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
            existence=probability,
        )
        for number in range(first, first + count)
    )
