"""Demos whose nodes are killed, and what comes of their beliefs."""
