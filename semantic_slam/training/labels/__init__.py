"""What a detector calls things, learned from runs of the user's own: from their beliefs, without anybody's labels."""
