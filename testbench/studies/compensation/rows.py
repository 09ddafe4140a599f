"""Tables of the study of compensation: a row a plan; a row a model, campaign and job of a trial."""

from dataclasses import dataclass

Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


@dataclass(frozen=True)
class PlanRow:
    """A planned campaign."""

    loads: str  #: What loads the arm, WEIGHT or BOTH.
    poses: int
    q_rad: tuple[float, ...]  #: Joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads acts in each, (poses,).


@dataclass(frozen=True)
class Scene:
    """What all trials share."""

    candidates: Angles = ()  #: Feasible poses to measure.
    drilling: Angles = ()  #: Programmed joints of the drilling pattern.
    milling: Angles = ()  #: The same of the milling path.
    plans: tuple[PlanRow, ...] = ()


@dataclass(frozen=True)
class JobRow:
    """One job of one trial, corrected by one model."""

    true_arm: str
    arm: str  #: What it does that no model knows, one of ARMS.
    by: str  #: How poses were chosen, PLANNED or RANDOM; empty for a model that is not identified.
    loads: str  #: What loaded the arm, WEIGHT or BOTH; the same.
    poses: int  #: How many were measured; 0 for the same.
    name: str  #: Of the model.
    chosen: str | None  #: Of the default: what it chose.
    job: str
    force: float  #: Of the process [N].
    #: Distance of the loaded tool from where it was asked, not corrected, point by point, (points,) [mm].
    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]  #: The same, corrected.
    inside: int  #: Components of what is left that lie in their 95 % interval, of those that have a bound.
    of: int  #: So many have one; 0 for a model that has no intervals.
    unseen: int  #: And so many have none, as the readings say nothing of them.
    buckled: bool  #: Whether the model had no equilibrium under the process; nothing is corrected then.
    solved: int  #: Points for which joints were found.
