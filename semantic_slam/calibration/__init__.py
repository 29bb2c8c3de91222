"""Calibration of noise parameters by maximising the evidence of a drive; needs and uses no ground truth."""
