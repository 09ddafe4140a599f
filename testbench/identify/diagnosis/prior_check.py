"""What the readings say against a prior, and what they cannot say: scales of links and joints."""

import math
from dataclasses import dataclass

from testbench.errors import Array
from testbench.identify.evidence import ALIKE, greatest, posterior, student_density
from testbench.identify.hierarchy import Evidence, evidence
from testbench.identify.metric import Belief, Metric, Scale
from testbench.identify.regression import Regression

TOLD, FAR = 2.5, 2.0
"""Standard deviations, and factor, from which a scale that the readings want is a doubt about the prior."""
TENFOLD, OPEN = math.log(10), 2.0
"""Logarithm of a scale that the readings would have to refuse, and loss of evidence at which they do."""


def contradicted(belief: Belief) -> tuple[Scale, ...]:
    """The scales of a learnt prior that the readings contradict."""

    def wrong(scale: Scale) -> bool:
        size = abs(math.log(scale.factor))
        return size > math.log(FAR) and size > TOLD * scale.deviation

    return tuple(filter(wrong, belief.scales))


@dataclass(frozen=True)
class Unchecked:
    """Links and joints that may be ten times off the prior without the readings telling."""

    stiffer: tuple[str, ...] = ()  #: Those that may be ten times stiffer.
    softer: tuple[str, ...] = ()  #: Those that may be ten times softer.


def unchecked(regression: Regression, metric: Metric) -> Unchecked:
    """What the readings leave open of a prior.

    Args:
        regression: The reduced dataset.
        metric: Of the structure and the prior.

    Returns:
        Names of links and joints, no parts of a link: with a tenfold scale, and all others as they suit it
        best, the evidence falls by less than `OPEN`.
    """
    seen = evidence(regression, metric)
    best = greatest(seen.problem, seen.start)
    whole = [k for k, size in enumerate(metric.sizes) if size == 6 or metric.kinds[k] == 1]
    stiffer, softer = (
        tuple(metric.names[k] for k in whole if _loss_at(seen, best, k, sign * TENFOLD) < OPEN)
        for sign in (-1, 1)
    )
    return Unchecked(stiffer, softer)


def _loss_at(seen: Evidence, best: Array, k: int, size: float) -> float:
    """By how much the evidence falls with the logarithm of block k's scale this far from its kind's."""
    start, kind = best.copy(), seen.blocks + seen.kind[k]
    start[k] = best[kind] + size
    h = greatest(seen.problem, start, held=k)
    own, before = (float(student_density((x[k] - x[kind]) / ALIKE)[0]) for x in (h, best))
    return posterior(seen.problem, h).loss - posterior(seen.problem, best).loss - own + before
