"""Label confusions of a detector, learned from the beliefs of the user's own runs, without annotations."""
