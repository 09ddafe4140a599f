"""Views of a file of measured runs: what was understood, in words, as a picture, as a recording."""
