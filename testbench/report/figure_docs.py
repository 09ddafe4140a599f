"""Matplotlib without tables of properties in its docstrings; to be imported before figures are.

Every class of artists lists all of its setters in several docstrings: a fifth of the time of the import.
"""

import matplotlib.artist


def _none(artist: object) -> str:
    """Stand in for `matplotlib.artist.kwdoc`, the table of an artist's properties."""
    del artist
    return ""


matplotlib.artist.kwdoc = _none
