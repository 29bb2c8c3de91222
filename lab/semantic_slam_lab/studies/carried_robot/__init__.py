"""A robot that is carried elsewhere in mid-drive, of which odometry tells nothing."""
