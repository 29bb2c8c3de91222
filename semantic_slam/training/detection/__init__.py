"""Detection probabilities of a detector, learned from the user's own runs."""
