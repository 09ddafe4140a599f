"""The composers: a cell, campaigns in it, fits, candidates and plans."""
