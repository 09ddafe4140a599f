"""Readings: datasets, their files, and the instruments that make them."""
