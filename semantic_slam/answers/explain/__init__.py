"""Explanation of a belief: the evidence behind one object, by re-running the inference of a belief bag."""
