"""Fits the class models of ``semantic_slam.viewpoint``: fit for all classes, regression for one.

The data (samples) come from turntables (fit) or from a bag whose poses are known (known_poses); calibration judges a
model on views left out, and page shows it.
"""
