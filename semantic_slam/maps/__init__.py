"""Persistent maps: one file from which later runs start, and comparison and merging of two maps."""
