"""Which poses to measure, and what they pay."""
