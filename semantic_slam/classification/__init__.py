"""Class posterior of one object seen along a track (chapter 3)."""
