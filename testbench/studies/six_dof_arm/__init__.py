"""Section 5.2: the illustrative 6R arm, full poses under single-axis loads, LS against GCO, the order m."""
