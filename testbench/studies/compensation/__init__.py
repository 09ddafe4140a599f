"""What a corrected robot removes: identified, compensated, executed on the true elastic arm, measured."""
