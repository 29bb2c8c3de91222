"""Evaluation of estimates against ground truth."""
