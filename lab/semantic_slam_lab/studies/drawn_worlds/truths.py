"""What worlds are drawn from, which the engine is not told of: as its configuration states, or one thing apart."""

from semantic_slam_lab.studies.drawn_worlds.worlds import Truth

RIGHT = "as stated"
TRUTHS = {
    RIGHT: Truth(),
    "noise understated 2x": Truth(noise=2.0),
    "noise understated 5x": Truth(noise=5.0),
    "correlation 0.95": Truth(correlated_share=0.95),
    "2 % outliers": Truth(outliers=0.02),
    "yaw bias 0.1 rad/m": Truth(turn_rad_per_m=0.1),
}
WITHIN_PRIOR = ("noise understated 2x", "yaw bias 0.1 rad/m")
"""What the configuration allows for: noise of twice the sigmas is one of the levels that it weighs, for odometry and
detections alike, and the bias is two standard deviations of its prior. The others, besides RIGHT, it knows nothing of.
"""
