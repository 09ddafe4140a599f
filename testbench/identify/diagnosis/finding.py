"""A hypothesis about what was handed in, as data, and the one test of it: a mistake b beside a fit adds Z b.

    g = Z^T (1 - P) e,   M = Z^T (1 - P) Z + 1,   nats = (g^T M^-1 g - log det M) / 2

with e the residuals, 1 - P what takes out all that the fit explains, and b ~ N(0, 1) in the units of Z: the
logarithm of a Bayes factor (Kass and Raftery 1995). What is not linear - units, signs, orders - is undone and
fitted again, and its nats are the loss that this saves.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from testbench.errors import Array


@dataclass(frozen=True)
class Finding:
    """What may be wrong; `campaign.doubt` has the sentences."""

    kind: str  #: A word for programs, such as "frame".
    where: tuple[str, ...] = ()  #: Names of what it is in: joints, links, targets, runs, series.
    size: Array = field(default_factory=lambda: np.zeros(0))  #: How large it is, (k,), SI.
    beside: Mapping[str, float] = field(default_factory=dict)  #: Other numbers of it, by name, SI.
    #: By how many nats the readings are likelier with the mistake than without; None for what is plain.
    nats: float | None = None


@dataclass(frozen=True)
class Tested:
    """How large mistakes look, and how much likelier they make the readings; of one, or of a batch."""

    b: Array  #: Expected sizes, (..., z), in the units of Z.
    gain: Array  #: Twice what they take away from the loss, g^T M^-1 g, (...).
    nats: Array  #: Logarithms of the Bayes factors, (...).


def test(g: Array, M: Array) -> Tested:
    """The score test of a batch of hypotheses.

    Args:
        g: Z^T (1 - P) e, whitened, (..., z).
        M: Z^T (1 - P) Z, (..., z, z).
    """
    own = M + np.eye(g.shape[-1])
    b = np.asarray(np.linalg.solve(own, g[..., None])[..., 0])
    gain = np.asarray((b * g).sum(axis=-1))
    return Tested(b, gain, np.asarray((gain - np.linalg.slogdet(own)[1]) / 2))
