"""Contract tests for pytest, one per plug-in kind: the test of a new implementation subclasses the contract class."""
