"""Find mistakes in readings: one table of hypotheses, each undone, fitted again and compared."""
