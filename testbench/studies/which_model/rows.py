"""A trial's rows: errors, intervals and doubts of every method in every case."""

from dataclasses import dataclass

from testbench.identify import Constraint
from testbench.trials.spread import Share


@dataclass(frozen=True)
class Case:
    """A true arm, and a prior that is known of it."""

    truth: str  #: Its name.
    prior: str  #: Name of the prior, which not every method knows.
    off_tubes: float  #: Median distance of the true links from tubes [1].
    #: RMS error over the workspace of the folder's compliances as they are [mm].
    cad_mm: float
    wrong: str | None  #: What is ten times off in the prior: a link's name, or "joints"; None for nothing.
    #: Of a wrong link: RMS of the true deflection over the workspace that is its own, over the whole [1].
    share: float | None


@dataclass(frozen=True)
class Cover:
    """95 % intervals of the components of deflection over the workspace."""

    covered: float  #: Share of the true components that lie inside [1].
    half_mm: float  #: Median half width [mm].
    ideal_mm: float  #: Half width of the narrowest intervals, all alike, that cover 95 % [mm].


@dataclass(frozen=True)
class Doubted:
    """What the readings are said to tell of the prior."""

    contradicted: tuple[str, ...]  #: Links and joints, or "joints", whose scales they contradict.
    #: Links and joints that may be off as the wrong link is; None where no link of the prior is wrong.
    unchecked: tuple[str, ...] | None


@dataclass(frozen=True)
class FitRow:
    """One method in one case."""

    case: Case
    poses: int  #: From how many was identified.
    method: str
    structure: str
    constraint: Constraint
    filled: bool  #: Whether it knows the prior.
    workspace_mm: float  #: RMS error over the workspace, against the truth.
    check_mm: float  #: RMS error at check poses, against the truth.
    misfit: float  #: F_M over the floor to expect of noise [1].
    conservative: Share
    solved: Share  #: Whether the method found what it looks for.
    chosen: str | None  #: Of the default: the method that it chose.
    cover: Cover | None  #: Of the methods whose intervals are judged.
    doubted: Doubted | None  #: Of the default.
