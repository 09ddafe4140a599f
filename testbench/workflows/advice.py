"""What an estimate cannot say by numbers alone: what filled free directions, doubts of the fit, outliers."""

from dataclasses import replace

import numpy as np

from testbench.identify.certify import TIE_BREAK
from testbench.identify.estimate import PAPERS, Average, Estimate
from testbench.identify.huber import NO_OUTLIERS, REJECT
from testbench.identify.least_squares import COMPLETED
from testbench.identify.metric import Belief

MISFIT = 2.0  #: F_M over its floor beyond which noise is no explanation.
MOST_REJECTED = 1 / 3  #: Share of rejected readings beyond which it is doubted that they are outliers.
MINIMUM_NORM = "least squares filled the free directions with the solution of minimum norm"
NEAREST = (
    "least squares filled the free directions with the conservative model nearest to the solution of minimum "
    "norm"
)


def advice(estimate: Estimate) -> tuple[str, ...]:
    """Sentences for a person."""
    return (
        *_of_rank(estimate),
        *_of_fit(estimate.average.whole if estimate.average else estimate),
        *_of_method(estimate),
        *of_average(estimate.average),
        *_of_outliers(estimate),
        *estimate.advice,
    )


def _of_rank(estimate: Estimate) -> list[str]:
    s, rank = estimate.of_compliances.structure, estimate.of_compliances.rank
    if rank == s.n:
        return []
    text = f"{s.name}: {s.n} unknowns, the data see {rank} directions; free are {s.n - rank}"
    unseen = int((estimate.of_compliances.columns == 0).sum())
    return [f"{text}, of which no load touches {unseen}" if unseen else text]


def _of_fit(estimate: Estimate) -> list[str]:
    cost, floor = estimate.f_m, estimate.f_m_floor
    if cost <= MISFIT * floor:
        return []
    why = "wrong structure, sigma, load, unit or frame"
    return [f"{estimate.structure.name}: F_M is {cost:.3g} where noise alone leaves {floor:.3g}: {why}"]


def _of_method(estimate: Estimate) -> list[str]:
    """What filled free directions, and what is not as it should be."""
    name, free = estimate.structure.name, estimate.regression.rank < estimate.structure.n
    if estimate.belief is not None:
        return [of_prior(estimate.belief)]
    if estimate.constraint == "psd" and estimate.certificate is not None:
        penalty = estimate.penalty
        if penalty is not None and not estimate.method.startswith(PAPERS):
            return [f"GCO: trace weight {penalty.weight:.3g} N m/rad, learnt unless it was given"]
        said = [f"GCO filled the free directions with the least trace, weight {TIE_BREAK:g}"] * free
        if estimate.held_by_trace_weight:
            said.append(
                f"{name}: only the trace weight holds unseen compliance, which fits a "
                "little better as it grows; predictions away from the measured poses hang on it"
            )
        return said
    if estimate.method.startswith(COMPLETED):
        return [NEAREST]
    if estimate.constraint not in ("none", "free"):
        return []
    left = estimate.constraint == "free" and estimate.status != "solved"
    return [MINIMUM_NORM] * free + [f"{name}: {estimate.status}"] * left


def of_prior(belief: Belief) -> str:
    """Which prior filled what the data cannot see."""
    strength, name = belief.strength, belief.metric.prior
    if strength.coupling is not None:
        shape, coupling = (100 * belief.misfit * u for u in (strength.uncertainty, strength.coupling))
        learnt = f"shapes known to {shape:.2g} %, couplings to {coupling:.2g} %"
        return f"prior: {name}, the scale of every block learnt from the readings, {learnt}"
    scale = (
        "its scale left to the data"
        if np.isinf(strength.scale_uncertainty)
        else f"its scale known to {100 * strength.scale_uncertainty:g} %"
    )
    return f"prior: {name}, uncertainty {100 * strength.uncertainty:.3g} %, {scale}"


def of_average(average: Average | None) -> list[str]:
    """How much joints alone count, or laws of the joints; nothing where neither does."""
    if average is None or not (average.laws or average.weight or average.ties):
        return []
    if average.ties == 1:
        return ["the evidence is for joints that are coupled with each other"]
    if average.ties:
        said = f"joints that are coupled with each other weigh {100 * average.ties:.3g} % by evidence"
        return [said, *of_average(replace(average, ties=0.0))]
    if average.laws == 1:
        return ["the evidence is for joints that stiffen, have backlash or friction"]
    if average.laws:
        return [
            f"linear joints, averaged with joints that stiffen, have backlash or friction, which weigh "
            f"{100 * average.laws:.3g} % by evidence"
        ]
    share = f"{100 * average.weight:.3g} %"
    if average.weight > 0.5:
        return [f"link compliances do not improve the model: joint stiffness only weighs {share} by evidence"]
    return [f"links and joints, averaged with joint stiffness only, which weighs {share}"]


def _of_outliers(estimate: Estimate) -> list[str]:
    """What was rejected, and whether that can still be outliers."""
    bad = len(estimate.rejected)
    if not bad:
        return []
    every = bad + estimate.regression.equations // 3
    said = [f"{bad} of {every} readings rejected, beyond {REJECT} standard deviations"]
    if estimate.lost:
        runs = ", ".join(map(str, estimate.lost))
        said.append(f"no reading is left of run {runs}: look at the load, the pose and the frame there")
    if bad > MOST_REJECTED * every:
        said.append(f"too many to be outliers: {NO_OUTLIERS}")
    return said
