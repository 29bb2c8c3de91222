"""A process that ends in the midst of what it says: ``python -m worlds.half_a_message SOCKET``."""

import os
import struct
import sys

if __name__ == "__main__":
    os.write(int(sys.argv[1]), struct.pack("!i", 1000) + b"half")
