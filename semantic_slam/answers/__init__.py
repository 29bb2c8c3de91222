"""Questions to a map: which of its objects is meant, with what probability."""
