"""How often a detector detects what is in view, as runs of it have shown."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DetectionValues:
    """What the next run takes in place of its configuration's; None: too little was seen to tell."""

    probability: float | None = None  # right at the sensor, nothing hiding
    half_range_m: float | None = None  # where that is half as likely; None: the same everywhere in the region
    persistence: float | None = None  # of whether an object can be detected, from one keyframe to the next


UNTOLD = DetectionValues()
