"""Matplotlib without tables of properties in its docstrings; to be imported before figures are.

Every class of artists lists all of its setters in the signature and docstring of `set` and in several other
docstrings: a fifth of the time of the import.
"""

import matplotlib.artist


def _none(artist: object) -> str:
    """Stand in for `matplotlib.artist.kwdoc`, the table of an artist's properties."""
    del artist
    return ""


matplotlib.artist.kwdoc = _none
matplotlib.artist.Artist._update_set_signature_and_docstring = classmethod(_none)  # type: ignore[attr-defined]
