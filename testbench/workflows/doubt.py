"""Doubts of fits in sentences: scales of a prior that readings contradict, readings that scatter too little.

Mistakes in readings have theirs in `identify.diagnosis.hypotheses`.
"""

import math
from collections.abc import Iterable

from scipy.special import gammainc

from testbench.errors import Doubt
from testbench.files.readings import SIGMA
from testbench.identify import Estimate
from testbench.identify.hierarchy import ALL_JOINTS
from testbench.identify.metric import LearntScale

QUIET, CHANCE = 0.6, 1e-6
"""Share of the floor below which F_M is a doubt, and chance of it in sound readings from which it is none."""


def of_scale(scale: LearntScale) -> Doubt:
    """Doubt a scale of a learnt prior that the readings contradict."""
    low, high = (scale.factor * math.exp(sign * 2 * scale.deviation) for sign in (-1, 1))
    beside = "the links" if scale.name == ALL_JOINTS else "the others of its kind"
    factor = f"{scale.factor:.2g} times ({low:.2g} to {high:.2g})"
    words = f"by the readings its compliance is {factor} the prior's, relative to {beside}: check the folder"
    return Doubt("prior", f"{scale.name}: {words}")


def of_noise(estimates: Iterable[Estimate]) -> list[Doubt]:
    """Doubt the noise where a model leaves far less than the stated noise alone would."""
    quiet = [estimate for estimate in estimates if estimate.f_m < QUIET * estimate.f_m_floor]
    if not quiet:
        return []
    least = min(quiet, key=lambda e: e.f_m / e.f_m_floor)
    free = least.regression.equations - least.regression.rank
    if gammainc(free / 2, free / 2 * (least.f_m / least.f_m_floor) ** 2) > CHANCE:
        return []
    words = (
        f"{least.structure.name} leaves F_M {least.f_m:.2g} where noise alone leaves "
        f"{least.f_m_floor:.3g}: is sigma too large ({1e6 * SIGMA[0]:g} um if none is stated; perhaps "
        "a U95), or were readings averaged or copied?"
    )
    return [Doubt("noise", words)]
