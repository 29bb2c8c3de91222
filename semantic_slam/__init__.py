"""Object-level semantic SLAM with a hybrid belief over poses, classes and data association."""

import os

# Matrices here are small and many: OpenBLAS's threads cost ten times what they gain, and more beside other processes.
# It reads this when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
