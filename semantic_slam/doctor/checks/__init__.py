"""What may be wrong with an input, one kind a file: summary in, findings out."""
