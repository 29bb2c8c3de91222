"""Estimates against references: pure functions, no files, no ROS."""
