"""What may be wrong with readings: one table of hypotheses, each undone, fitted again and compared."""
