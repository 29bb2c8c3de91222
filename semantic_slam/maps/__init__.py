"""Maps that outlive their run: one file, from which later runs start, and what changed between two of them."""
