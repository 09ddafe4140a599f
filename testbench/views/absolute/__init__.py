"""A calibration by absolute readings in words, tables, a figure and files."""
