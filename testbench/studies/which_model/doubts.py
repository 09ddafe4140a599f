"""Whether the readings tell that a prior is wrong: doubts that are right, doubts that are not."""

from collections.abc import Callable, Sequence

import numpy as np

from testbench.bench.wrong_prior import PRIORS
from testbench.studies.which_model.report import DoubtAt
from testbench.studies.which_model.rows import Case, Doubted, FitRow
from testbench.trials.spread import grouped

MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
Found = tuple[FitRow, Doubted]


def doubt_table(rows: Sequence[FitRow]) -> list[DoubtAt]:
    """By prior, a wrong link also by its deflection and by its name; by number of poses, and over all."""
    found = [(row, row.doubted) for row in rows if row.doubted is not None]
    ways: list[Callable[[Case], str]] = [lambda _: "all", _moving, _link]
    table = []
    for way in ways:
        groups = grouped(found, lambda own: (own[0].case.prior, way(own[0].case)))  # noqa: B023 - used at once
        for (prior, what), own in groups.items():
            if what:
                table += _by_poses(prior, what, own)
    return sorted(
        table, key=lambda own: (list(PRIORS).index(own.prior), own.what.startswith("link_"), own.what)
    )


def _moving(case: Case) -> str:
    if case.share is None:
        return ""
    return f"{'more' if case.share > MOVES else 'less'} than {100 * MOVES:.0f} % of the deflection"


def _link(case: Case) -> str:
    return "" if case.share is None or case.wrong is None else case.wrong


def _by_poses(prior: str, what: str, own: Sequence[Found]) -> list[DoubtAt]:
    groups = grouped(own, lambda found: found[0].poses)
    return [_doubt_at(prior, what, poses, cases) for poses, cases in [(None, own), *sorted(groups.items())]]


def _doubt_at(prior: str, what: str, poses: int | None, own: Sequence[Found]) -> DoubtAt:
    told = [row.case.wrong in doubted.contradicted for row, doubted in own if row.case.wrong]
    open_ = [row.case.wrong in doubted.unchecked for row, doubted in own if doubted.unchecked is not None]
    linked = prior == "link"
    return DoubtAt(
        prior,
        what,
        poses,
        cases=len(own),
        doubted=float(np.mean([bool(doubted.contradicted) for _, doubted in own])),
        told=float(np.mean(told)) if told else None,
        unchecked=float(np.mean(open_)) if linked else None,
        named=float(np.mean([len(doubted.unchecked or ()) for _, doubted in own])) if linked else None,
        either=float(np.mean([a or b for a, b in zip(told, open_, strict=True)])) if linked else None,
    )
