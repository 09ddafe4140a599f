"""Workflows of commands and studies: cells, simulated campaigns, choice among fits, plans, corrections."""
