"""Diagnosis of recordings and running systems: faults that prevent a correct map, each with its remedy."""
