"""A hypothesis about what was handed in, as data, and the one test of it: a mistake b beside a fit adds Z b.

    g = Z^T (1 - P) e,   M = Z^T (1 - P) Z + 1,   nats = (g^T M^-1 g - log det M) / 2

with e the residuals, 1 - P what takes out all that the fit explains, and b ~ N(0, 1) in the units of Z: the
logarithm of a Bayes factor (Kass and Raftery 1995). What is not linear - units, signs, orders - is undone and
fitted again, and its nats are the loss that this saves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from testbench.errors import Array

MOST = 5  #: Mistakes, or changes of several series at once, that are undone one after the other.
Data = TypeVar("Data")
Model = TypeVar("Model")


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


def one_by_one(
    data: Data,
    model: Model,
    undo: Callable[[Data, Model], tuple[Sequence[Finding], Data, Model] | None],
) -> tuple[list[Finding], Data, Model]:
    """Find the worst mistake, undo it, fit again, look for the next.

    Args:
        data: What was read.
        model: Fitted to it.
        undo: The worst mistake, the data without it and the model fitted to these; None where there is none.
            Data that are as they were end the search.

    Returns:
        The mistakes in the order in which they were found, data without them and the last model.
    """
    found: list[Finding] = []
    for _ in range(MOST):
        step = undo(data, model)
        if step is None:
            break
        before = data
        more, data, model = step
        found += more
        if data is before:
            break
    return found, data, model
