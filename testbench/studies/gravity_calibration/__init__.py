"""Section 6 in simulation: a heavy arm under a hung weight, three markers, LS against GCO."""
