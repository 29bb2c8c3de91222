"""Experiments that anyone can repeat with one command: ``run_study NAME --out DIR``."""
