"""Two models in the same trials, seed by seed."""

from dataclasses import dataclass

from testbench.trials.spread import Number


@dataclass(frozen=True)
class Duel:
    """A model against another one by true errors; alike are those a solver's last digits apart."""

    ours: str
    theirs: str
    check: int  #: Seeds in which ours has the smaller error at the check poses.
    workspace: int  #: The same over the workspace.
    alike: int  #: Seeds in which the two err alike over the workspace.
    seeds: int  #: Of all.
    cone: bool  #: Whether they differ in nothing but the cone.
    ratio: Number  #: Our error over the workspace over theirs.
