"""How often a detector detects what is in view, learned from runs of the user's own."""
