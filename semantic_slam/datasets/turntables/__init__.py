"""Turntables of photographs: a folder of crops whose names, or a table, tell object and direction."""
