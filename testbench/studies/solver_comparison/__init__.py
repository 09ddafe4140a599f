"""The paper's own optimiser against local solves and the conic program."""
