"""A robot's noise from the evidence of a whole drive: no truth is needed, and none is used."""
