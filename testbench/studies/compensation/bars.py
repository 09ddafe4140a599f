"""What was asked beforehand, beside what was found."""

from collections.abc import Sequence

from testbench.studies.bar import Bar
from testbench.studies.compensation.report import ALL, Group
from testbench.studies.compensation.settings import BARRED, DEFAULT, IDEAL, LINEAR, PERFECT

LEFT_UM = 1.0  #: Most that a perfect model may leave [um].
MEDIAN = 0.97  #: Least median share removed.
PART, OFTEN = 0.9, 0.95  #: Least share removed, and in which share of the cases.
COVERED = (0.93, 0.98)  #: Shares of components that intervals of 95 % have to hold.


def bars(groups: Sequence[Group]) -> list[Bar]:
    """Of the loop, and of the default from the campaign that is advised, undisturbed and disturbed."""
    every = [g for g in groups if g.job == ALL]
    [perfect] = [g for g in every if g.model == PERFECT and g.arm == IDEAL]
    found = [Bar("perfect model, left at most [um]", 1e3 * perfect.after.most_mm, None, LEFT_UM)]
    for own in every:
        if own.arm == LINEAR:
            continue  # a diagnosis, made after the disturbed arm was seen
        if own.model == DEFAULT and (own.by, own.loads, own.poses) == (BARRED.by, BARRED.loads, BARRED.poses):
            found += _of_default(own, own.arm)
    return found


def _of_default(own: Group, where: str) -> list[Bar]:
    assert own.covered is not None
    return [
        Bar(f"{where}, median share removed", own.removed.median, MEDIAN, None),
        Bar(f"{where}, share of cases with {PART:g} or more removed", own.nine, OFTEN, None),
        Bar(f"{where}, cases made worse", own.worse, None, 0),
        Bar(f"{where}, share left inside its 95 % interval", own.covered, *COVERED),
    ]
