"""Names of the frames in the bags that importers write, by REP-105 and REP-103."""

BODY_FRAME = "base_link"
CAMERA_FRAME = "camera_optical_frame"
