"""Contract tests for pytest: what every part of a kind promises. A new part's test is a subclass, here or elsewhere."""
