"""What the study of the default method reports: types of report.json."""

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.identify import Constraint
from testbench.trials.spread import Spread


@dataclass(frozen=True)
class MethodAt:
    """A method over the cases of some truths and priors, at one number of poses."""

    truth: str  #: Of the cases; empty for all.
    prior: str  #: The same.
    poses: int
    method: str
    structure: str
    constraint: Constraint
    filled: bool  #: Whether it knows the prior.
    cases: int
    workspace_mm: Spread  #: RMS error over the workspace, against the truth.
    check_mm: Spread  #: The same at check poses.
    misfit: Spread  #: F_M over its floor.
    conservative: float  #: Share of cases.
    solved: float
    over_joints: Spread  #: Error over that of joints alone, case by case.
    loses: float  #: Share of cases in which that exceeds 1 by more than the margin.
    over_best: Spread  #: Error over that of the method that is best over the family at this number of poses.
    over_least: Spread  #: Error over the least of any method in the same case.
    wins: float  #: Share of cases in which it is that of least error, or as good.


@dataclass(frozen=True)
class Advice:
    """At one number of poses, over the family, the method of least median error."""

    poses: int
    best: MethodAt
    without_prior: MethodAt  #: Of those that know no prior.
    joints: MethodAt  #: The incumbent.


@dataclass(frozen=True)
class TruthAt:
    """A true arm over all trials."""

    truth: str
    what: str  #: In words.
    off_tubes: Spread  #: Median distance of its links from tubes.
    cad_mm: Spread  #: RMS error over the workspace of the folder's compliances as they are.


@dataclass(frozen=True)
class WhichModelReport:
    """report.json."""

    scenario: str
    seed: int | list[int]
    arm: str
    noise: bool
    truth: str
    sigma_um: float
    trials: int
    workspace_poses: int
    runs_a_pose: int
    margin_percent: float  #: By how much a method's error must exceed that of joints alone for it to lose.
    advice: list[Advice]
    family: list[MethodAt]  #: Over all truths and priors.
    by_truth: list[MethodAt]
    by_prior: list[MethodAt]  #: Of methods that know it.
    cells: list[MethodAt]  #: Every truth with every prior.
    #: Truths and priors with which the best method of a number of poses loses to joints alone, worst first.
    losses: list[MethodAt]
    truths: list[TruthAt]
    priors: Mapping[str, str]  #: What is wrong with each, in words.
