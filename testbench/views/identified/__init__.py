"""A stiffness model identified from runs, in words, tables, a figure and files."""
