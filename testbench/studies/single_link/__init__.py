"""Section 5.1: one link, least squares with 36 free entries against GCO."""
