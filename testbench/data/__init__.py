"""Readings: datasets of deflections, and series of absolute readings."""
