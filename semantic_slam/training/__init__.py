"""Training of the models used at run time; no code that runs on the robot imports this package.

classifier fits the network of perception (augmentation makes turntable views look like a room); viewpoint fits the
class models of ``semantic_slam.viewpoint``; latent fits extractor, decoder, encoder and noise of
``semantic_slam.latent``. Turntables and views hold the pictures that all three start from.
"""
