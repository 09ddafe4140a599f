"""A prediction in words, a table of all poses, a figure and files."""
