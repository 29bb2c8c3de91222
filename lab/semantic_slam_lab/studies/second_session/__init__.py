"""A robot that comes back to a room in which something has changed."""
