"""Class name shared by all class sources."""

NONE_OF_THESE = "none of these"
"""Class of objects that belong to no other class."""
