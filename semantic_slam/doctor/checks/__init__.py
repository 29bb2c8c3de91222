"""Checks of an input, one kind of fault per file: each maps a summary to findings."""
