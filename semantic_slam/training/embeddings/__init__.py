"""How the vectors of an object's views go with the direction of view, learned from runs of the user's own."""
