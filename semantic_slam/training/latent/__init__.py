"""Fits the models of ``semantic_slam.latent``; fit runs all of it, in the formulation that is asked for.

``views`` are what it is given. In ``fitting`` principal_components and regression_training give the features of the MAP
formulation, joint_training learns them with the decoder by contrast or energy; map_training fits decoder, descriptors
and encoder, change_training the model over changes of viewpoint, class_grounding the classes, and refinement goes on
from a SLAM posterior. In ``judging`` calibration fits the noise, estimation infers directions and descriptors from
features, evaluation judges by it; report puts it in numbers.
"""
