"""A robot that is put down somewhere on a map that it has, and does not know where."""
