"""A run as one HTML file that opens anywhere: words, tables, charts, the arm, the map of its errors."""
