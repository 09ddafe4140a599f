"""What an estimate is judged by: errors over the workspace, its intervals, what is said of the prior."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True)
class Error:
    """Of predicted deflections, against the truth."""

    rms_mm: float


@dataclass(frozen=True)
class Case:
    """A true arm, and a prior that is known of it."""

    true_arm: str  #: Its name.
    prior_error: str  #: Name of what is wrong with the prior, which not every method knows.
    off_tubes_percent: float  #: Median distance of the true links from tubes.
    #: RMS error over the workspace of the folder's compliances as they are [mm].
    cad_mm: float
    wrong: str | None  #: What is ten times off in the prior: a link's name, or "joints"; None for nothing.
    #: Of a wrong link: RMS of the true deflection over the workspace that is its own, over the whole [1].
    link_share: float | None


@dataclass(frozen=True)
class Cover:
    """95 % intervals of the components of deflection over the workspace."""

    covered_percent: float  #: Share of the true components that lie inside.
    half_mm: float  #: Median half width.
    ideal_mm: float  #: Half width of the narrowest intervals, all alike, that cover 95 %.


@dataclass(frozen=True)
class Doubted:
    """What the readings are said to tell of the prior."""

    contradicted: tuple[str, ...]  #: Links and joints, or "joints", whose scales they contradict.
    #: Links and joints that may be off as the wrong link is; None where no link of the prior is wrong.
    unchecked: tuple[str, ...] | None


def case_of(cell: Cell, names: tuple[str, str], campaign: Campaign, estimate: Estimate) -> Case:
    """A truth and a prior by these names; any estimate lends its structure."""
    truth, far = campaign.truth, PRIORS[names[1]].far
    as_it_is = replace(estimate, C_theta=cell.arm.C_theta)
    link = wrong_link(cell, campaign.seed) if far == "link" else None
    wrong = cell.arm.links[link].name if link is not None else None
    return Case(
        *names,
        off_tubes_percent=100 * _off_tubes(cell),
        cad_mm=errors(cell, [as_it_is], truth)[0].rms_mm,
        wrong=KIND if far == "joints" else wrong,
        link_share=None if link is None else _share(cell, link, truth, estimate),
    )


def errors(cell: Cell, estimates: Sequence[Estimate], truth: Dataset) -> list[Error]:
    """Of each estimate, against true deflections."""
    moved = all_deflections(cell.vjm, estimates, truth)
    return [Error(MM * score(own, truth.deflection).rms) for own in moved]


def cover(cell: Cell, estimate: Estimate, truth: Dataset) -> Cover:
    """The intervals of an estimate beside true deflections."""
    found, true = intervals(cell.vjm, estimate, truth), truth.deflection
    return covers(found.centre, (found.upper - found.lower) / 2, true)


def covers(centre: Array, half: Array, true: Array) -> Cover:
    """How well intervals of these half widths cover what is true, arrays of one shape [m]."""
    error = np.abs(centre - true)
    return Cover(
        covered_percent=100 * float(np.mean(error <= half)),
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
        if case.link_share is None
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
