"""Whether intervals hold: how many true deflections lie inside, and how wide they are."""

from collections.abc import Callable, Sequence

import numpy as np

from testbench.bench.truths import TRUTHS
from testbench.bench.wrong_prior import PRIORS
from testbench.studies.which_model.report import CoverAt
from testbench.studies.which_model.rows import Cover, FitRow
from testbench.trials.spread import grouped, spread

Group = tuple[str, str, int | None]
"""Truth, prior and number of poses, as in `CoverAt`."""


def coverage(rows: Sequence[FitRow]) -> list[CoverAt]:
    """Over all cases, by number of poses, by truth and by prior, of every method that is judged so."""
    judged = [(row, row.cover) for row in rows if row.cover is not None]
    ways: list[Callable[[FitRow], Group]] = [
        lambda _: ("", "", None),
        lambda row: ("", "", row.poses),
        lambda row: (row.case.truth, "", None),
        lambda row: ("", row.case.prior, None),
    ]
    found = []
    for way in ways:
        groups = grouped(judged, lambda own: (*way(own[0]), own[0].method))  # noqa: B023 - used at once
        found += [_cover_at(key, [cover for _, cover in own]) for key, own in groups.items()]
    return sorted(found, key=_place)


def _cover_at(key: tuple[str, str, int | None, str], own: Sequence[Cover]) -> CoverAt:
    covered = [cover.covered for cover in own]
    return CoverAt(
        *key,
        cases=len(own),
        covered=float(np.mean(covered)),  # every case has as many components
        by_case=spread(covered),
        half_mm=spread([cover.half_mm for cover in own]),
        ideal_mm=spread([cover.ideal_mm for cover in own]),
        over_ideal=spread([cover.half_mm / cover.ideal_mm for cover in own]),
    )


def _place(own: CoverAt) -> tuple[int, int, int]:
    """In the order of their lists: trials meet truths and priors in others."""
    truths, priors = ["", *TRUTHS], ["", *PRIORS]
    return truths.index(own.truth), priors.index(own.prior), own.poses or 0
