"""A robot that tours a building for a day: what every keyframe costs, and what is held for it."""
