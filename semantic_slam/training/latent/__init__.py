"""Fits the models of ``semantic_slam.latent``; fit runs all of it, in the formulation that is asked for.

principal_components and regression_training give the features of the MAP formulation, joint_training learns them with
the decoder by contrast or energy; map_training fits decoder, descriptors and encoder, change_training the model over
changes of viewpoint, calibration the noise, class_grounding the classes, and refinement goes on from a SLAM posterior.
estimation infers directions and descriptors from features; evaluation judges by it, and report puts it in numbers.
"""
