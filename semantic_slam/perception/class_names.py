"""A name that classes of every source share."""

NONE_OF_THESE = "none of these"
"""The class of what is of no other class."""
