"""What an estimate is judged by: errors over the workspace, its intervals, what is said of the prior."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.bench.campaign import Campaign, Cell
from testbench.bench.rows import MM
from testbench.bench.truths import distance_from_tubes
from testbench.bench.wrong_prior import PRIORS, wrong_link
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import Estimate, intervals
from testbench.identify.contradiction import Unchecked, contradicted, unchecked
from testbench.identify.evaluate import all_deflections, score
from testbench.identify.hierarchy import KIND
from testbench.identify.intervals import CONFIDENCE
from testbench.identify.metric import metric
from testbench.identify.prior import Prior
from testbench.studies.which_model.rows import Case, Cover, Doubted


def case_of(cell: Cell, names: tuple[str, str], campaign: Campaign, estimate: Estimate) -> Case:
    """A truth and a prior by these names; any estimate lends its structure."""
    truth, far = campaign.truth, PRIORS[names[1]].far
    as_it_is = replace(estimate, C_theta=cell.arm.C_theta)
    link = wrong_link(cell, campaign.seed) if far == "link" else None
    wrong = cell.arm.links[link].name if link is not None else None
    return Case(
        *names,
        off_tubes=_off_tubes(cell),
        cad_mm=errors_mm(cell, [as_it_is], truth)[0],
        wrong=KIND if far == "joints" else wrong,
        share=None if link is None else _share(cell, link, truth, estimate),
    )


def errors_mm(cell: Cell, estimates: Sequence[Estimate], truth: Dataset) -> list[float]:
    """RMS errors against true deflections [mm]."""
    moved = all_deflections(cell.vjm, estimates, truth)
    return [MM * score(own, truth.deflection).rms for own in moved]


def cover(cell: Cell, estimate: Estimate, truth: Dataset) -> Cover:
    """The intervals of an estimate beside true deflections."""
    found, true = intervals(cell.vjm, estimate, truth), truth.deflection
    return covers(found.centre, (found.upper - found.lower) / 2, true)


def covers(centre: Array, half: Array, true: Array) -> Cover:
    """How well intervals of these half widths cover what is true, arrays of one shape [m]."""
    error = np.abs(centre - true)
    return Cover(
        covered=float(np.mean(error <= half)),
        half_mm=MM * float(np.median(half)),
        ideal_mm=MM * float(np.quantile(error, CONFIDENCE)),
    )


def doubted(cell: Cell, case: Case, estimate: Estimate, prior: Prior) -> Doubted:
    """What the readings contradict of a prior and, if one link of it is wrong, which scales they leave open.

    Open in the direction in which that link is wrong: stiffer than a prior that is ten times too soft.

    An estimate without a prior leaves all of it open.
    """
    names = [*(part.name for part in cell.arm.links), *(part.name for part in cell.arm.joints)]
    if estimate.belief is None:
        return Doubted((), tuple(names))
    own = metric(prior, cell.vjm, estimate.structure)
    return Doubted(
        contradicted=tuple(scale.name for scale in contradicted(estimate.belief)),
        unchecked=None
        if case.share is None
        else _open(cell, case, prior, unchecked(estimate.regression, own)),
    )


def _open(cell: Cell, case: Case, prior: Prior, found: Unchecked) -> tuple[str, ...]:
    """What is left open in the direction in which the wrong link is wrong."""
    folder = cell.arm.C_theta
    sizes = [
        np.trace(prior.C_theta[k : k + 6, k : k + 6]) / np.trace(folder[k : k + 6, k : k + 6])
        for k in range(0, 6 * len(cell.arm.links), 6)
    ]
    [wrong] = [k for k, link in enumerate(cell.arm.links) if link.name == case.wrong]
    return found.stiffer if sizes[wrong] > np.median(sizes) else found.softer


def _share(cell: Cell, link: int, truth: Dataset, estimate: Estimate) -> float:
    """RMS of the true deflection that is one link's over that of the whole arm, both linear [1]."""
    C, at = cell.plant.arm.C_theta, slice(6 * link, 6 * link + 6)
    own = np.zeros_like(C)
    own[at, at] = C[at, at]
    part, whole = all_deflections(cell.vjm, [replace(estimate, C_theta=M) for M in (own, C)], truth)
    return float(np.linalg.norm(part) / np.linalg.norm(whole))


def _off_tubes(cell: Cell) -> float:
    return float(np.median([distance_from_tubes(link.compliance) for link in cell.plant.arm.links]))
