"""What commands and studies share: a cell, simulated campaigns, fits and their choice, plans, corrections."""
