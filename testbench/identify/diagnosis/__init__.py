"""Find mistakes in readings: one table of hypotheses, each corrected, fitted again and compared."""
