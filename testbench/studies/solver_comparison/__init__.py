"""The paper's own optimiser of Eq. (19) against local solves and a conic program with a certificate."""
