"""How many times enlarged small things are drawn: round numbers that a reader can divide by."""

import math

import numpy as np

from testbench.errors import Array

MOST = 1e5  #: Largest magnification: what is below rounding is not drawn.


def round_scale(drawn: float, true: float, *, most: float = MOST) -> float:
    """Magnification 1, 2 or 5 times a power of ten, at most drawn / true and `most`.

    Args:
        drawn: Length on the drawing [m].
        true: What is drawn so long [m].
        most: Largest magnification, for lengths that hardly differ from none [1].
    """
    scale = min(drawn / max(true, 1e-30), most)
    power = 10.0 ** math.floor(math.log10(scale))
    return float(power * max(k for k in (1, 2, 5) if k * power <= scale * (1 + 1e-9)))


def arrow_scale(vectors: Array, longest: float) -> float:
    """Magnification by which 95 % of arrows, (..., 3) [m], are drawn no longer than that [m]; NaN: none."""
    size = np.linalg.norm(vectors, axis=-1)
    known = size[np.isfinite(size)]
    return round_scale(longest, float(np.quantile(known, 0.95)) if known.size else 0.0)
