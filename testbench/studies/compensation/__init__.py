"""Study of corrections: arms identified, programs compensated, executed on the true elastic arm, measured."""
