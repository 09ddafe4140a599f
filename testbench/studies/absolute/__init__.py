"""Absolute readings: of simulated arms, whose errors are known, and of a real UR10."""
