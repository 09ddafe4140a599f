"""Which poses to measure, and what they pay: plans by every criterion against random poses, simulated."""
