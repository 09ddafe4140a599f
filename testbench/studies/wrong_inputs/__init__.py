"""Wrong inputs, planted, and whether they are found out."""
