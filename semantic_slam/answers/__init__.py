"""Queries to a map: which of its objects match, with calibrated probabilities."""
