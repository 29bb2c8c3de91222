"""A camera that flies over tables, in all six of its pose."""
