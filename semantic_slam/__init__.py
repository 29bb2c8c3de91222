"""Object-level semantic SLAM with a hybrid belief over poses, classes and data association."""

__version__ = "0.1.0"
