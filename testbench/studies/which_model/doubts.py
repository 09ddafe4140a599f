"""Whether the readings tell that a prior is wrong: doubts that are right, doubts that are not."""

from collections.abc import Callable, Sequence

import numpy as np

from testbench.bench.truths import CALLED, TRUTHS
from testbench.bench.wrong_prior import PRIORS, RIGHT
from testbench.studies.which_model.report import EVERY, DoubtAt
from testbench.studies.which_model.rows import Case, Doubted, FitRow
from testbench.trials.spread import grouped

MOVES = 0.05  #: Share of the true deflection over the workspace from which a link is said to move it.
Found = tuple[FitRow, Doubted]
Kind = tuple[int, str]  #: Place in the table, and in words.


def doubt_table(rows: Sequence[FitRow]) -> list[DoubtAt]:
    """By prior, the right one by truth too, a wrong link by its deflection and name; by poses, and all."""
    found = [(row, row.doubted) for row in rows if row.doubted is not None]
    otherwise = named_otherwise(found)
    ways: list[Callable[[Case], Kind | None]] = [lambda _: (0, EVERY), _true, _moving, _link]
    by_prior = grouped(found, lambda own: own[0].case.prior)
    table = []
    for prior in sorted(by_prior, key=list(PRIORS).index):
        for way in ways:
            groups = grouped(by_prior[prior], lambda own: way(own[0].case))  # noqa: B023 - used at once
            for kind in sorted(kind for kind in groups if kind):
                table += _by_poses((prior, kind[1]), groups[kind], otherwise)
    return table


def named_otherwise(found: Sequence[Found]) -> dict[str, float]:
    """By link how often it is named as unchecked where the prior has another link wrong."""
    asked = [(row.case.wrong, doubted.unchecked) for row, doubted in found if doubted.unchecked is not None]
    links = sorted({wrong for wrong, _ in asked if wrong})
    named = {link: [link in names for wrong, names in asked if wrong != link] for link in links}
    return {link: float(np.mean(own)) for link, own in named.items() if own}


def _true(case: Case) -> Kind | None:
    return (list(TRUTHS).index(case.truth), CALLED[case.truth]) if case.prior == RIGHT else None


def _moving(case: Case) -> Kind | None:
    if case.share is None:
        return None
    more = case.share > MOVES
    return int(more), f"{'more' if more else 'less'} than {100 * MOVES:.0f} % of the deflection"


def _link(case: Case) -> Kind | None:
    return None if case.share is None or case.wrong is None else (0, case.wrong)


def _by_poses(names: tuple[str, str], own: Sequence[Found], otherwise: dict[str, float]) -> list[DoubtAt]:
    groups = grouped(own, lambda found: found[0].poses)
    every = [(None, own), *sorted(groups.items())]
    return [_doubt_at((*names, poses), cases, otherwise) for poses, cases in every]


def _doubt_at(key: tuple[str, str, int | None], own: Sequence[Found], otherwise: dict[str, float]) -> DoubtAt:
    told = [row.case.wrong in doubted.contradicted for row, doubted in own if row.case.wrong]
    linked = [
        (row.case.wrong or "", doubted.unchecked) for row, doubted in own if doubted.unchecked is not None
    ]
    named = [link in names for link, names in linked]
    others = [otherwise[link] for link, _ in linked if link in otherwise]
    return DoubtAt(
        *key,
        cases=len(own),
        doubted=float(np.mean([bool(doubted.contradicted) for _, doubted in own])),
        told=float(np.mean(told)) if told else None,
        unchecked=float(np.mean(named)) if linked else None,
        otherwise=float(np.mean(others)) if others else None,
        either=float(np.mean([a or b for a, b in zip(told, named, strict=True)])) if linked else None,
    )
