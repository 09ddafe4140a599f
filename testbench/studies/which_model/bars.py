"""What was asked of the default beforehand, beside what was found."""

from collections.abc import Sequence

from testbench.bench.wrong_prior import PRIORS
from testbench.studies.bar import Bar
from testbench.studies.which_model.methods import CHOSEN
from testbench.studies.which_model.report import EVERY, Advice, CoverAt, DoubtAt

OVER_BEST, LOSES = 1.1, 0.05
"""Largest median ratio to the best fixed method, and share of cases in which joints alone may be better."""
COVERED, AT_LEAST = (0.93, 0.98), 0.9
"""Share of components that intervals of 95 % must cover over the family, and with a prior ten times off."""
WIDTH = 2.0  #: Largest median half width over the ideal one.
TOLD = 0.9  #: Share of priors ten times off that must raise a doubt.


def bars(advised: Sequence[Advice], cover: Sequence[CoverAt], doubts: Sequence[DoubtAt]) -> list[Bar]:
    """All of them, in the order of the report."""
    own = [c for c in cover if c.method == CHOSEN]
    [every] = [c for c in own if c.every]
    spoilt = {name for name, wrong in PRIORS.items() if wrong.far}
    far = [c for c in own if c.prior in spoilt]
    wrong = [d for d in doubts if d.prior in spoilt and d.poses is None and d.what == EVERY]
    return [
        *(
            Bar(
                f"median error over the best fixed, {a.poses} poses",
                a.default.over_best.median,
                None,
                OVER_BEST,
            )
            for a in advised
        ),
        *(Bar(f"loses to joints alone, {a.poses} poses", a.default.loses, None, LOSES) for a in advised),
        Bar("covered", every.covered, *COVERED),
        *(Bar(f"covered, {c.where}", c.covered, AT_LEAST, None) for c in far),
        Bar("half width over the ideal, median", every.over_ideal.median, None, WIDTH),
        *(Bar(f"a doubt, prior {d.prior}", d.doubted, TOLD, None) for d in wrong),
    ]
