"""The report of all trials: every method over the family of truths and priors, beside joints alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.rows import UM
from testbench.bench.truths import TRUTHS
from testbench.bench.wrong_prior import PRIORS
from testbench.studies.study import Trials
from testbench.studies.which_model.methods import INCUMBENT
from testbench.studies.which_model.report import Advice, MethodAt, TruthAt, WhichModelReport
from testbench.studies.which_model.trial import NAME, RUNS, Case, FitRow, Settings
from testbench.studies.which_model.words import PRIOR_WORDS, TRUTH_WORDS
from testbench.trials.spread import SAME, grouped, spread

MARGIN = 0.05  #: Share by which a method's error must exceed that of joints alone for it to lose.


@dataclass(frozen=True)
class Judged:
    """A fit, and the errors of others in the same case [mm]."""

    row: FitRow
    joints: float
    best: float  #: Of the method that is best over the family at this number of poses.
    least: float


def summary(asked: Settings, seeds: range, trials: Trials[FitRow]) -> WhichModelReport:
    """Medians and spreads over the family, by truth, by prior and by both."""
    by_seed = [rows for _, rows in trials]
    rows = sorted(judged(by_seed), key=lambda own: _places(own.row.case))
    family = gathered(rows, lambda _: ("", ""))
    cells = gathered(rows, lambda row: (row.case.truth, row.case.prior))
    known = [own for own in rows if own.row.filled]
    advice = [_advice(own) for own in grouped(family, lambda m: m.poses).values()]
    return WhichModelReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        arm=find_arm(asked.arm).resolve().name,
        noise=True,
        truth="nonlinear",
        sigma_um=UM * asked.sigma,
        trials=len(seeds),
        workspace_poses=asked.workspace,
        runs_a_pose=RUNS,
        margin_percent=100 * MARGIN,
        advice=advice,
        family=family,
        by_truth=gathered(rows, lambda row: (row.case.truth, "")),
        by_prior=gathered(known, lambda row: ("", row.case.prior)),
        cells=cells,
        losses=losses(cells, advice),
        truths=_truths(by_seed),
        priors=PRIOR_WORDS,
    )


def judged(by_seed: Sequence[Sequence[FitRow]]) -> list[Judged]:
    """Every fit beside the others of its case: the same trial, truth and number of poses."""
    every = [row for rows in by_seed for row in rows]
    best = {
        poses: _least_median({m: [r.workspace_mm for r in same] for m, same in grouped(own, _method).items()})
        for poses, own in grouped(every, lambda row: row.poses).items()
    }
    found = []
    for rows in by_seed:
        for (_, poses), own in grouped(rows, lambda row: (row.case.truth, row.poses)).items():
            errors = {row.method: row.workspace_mm for row in own}
            beside = errors[INCUMBENT], errors[best[poses]], min(errors.values())
            found += [Judged(row, *beside) for row in own]
    return found


def _places(case: Case) -> tuple[int, int]:
    """Where truth and prior stand in their lists: trials meet them in other orders."""
    return list(TRUTHS).index(case.truth), list(PRIORS).index(case.prior)


def gathered(rows: Sequence[Judged], names: Callable[[FitRow], tuple[str, str]]) -> list[MethodAt]:
    """Fits of all trials by method, number of poses, and truth and prior as these are named."""
    groups = grouped(rows, lambda own: (*names(own.row), own.row.poses, own.row.method))
    return [_method_at(key[:2], own) for key, own in groups.items()]


def _method_at(names: tuple[str, str], own: Sequence[Judged]) -> MethodAt:
    first = own[0].row
    over = np.array([[j.row.workspace_mm / x for x in (j.joints, j.best, j.least)] for j in own])
    over_joints, over_best, over_least = (spread(column.tolist()) for column in over.T)
    return MethodAt(
        *names,
        poses=first.poses,
        method=first.method,
        structure=first.structure,
        constraint=first.constraint,
        filled=first.filled,
        cases=len(own),
        workspace_mm=spread([j.row.workspace_mm for j in own]),
        check_mm=spread([j.row.check_mm for j in own]),
        misfit=spread([j.row.misfit for j in own]),
        conservative=float(np.mean([j.row.conservative for j in own])),
        solved=float(np.mean([j.row.solved for j in own])),
        over_joints=over_joints,
        loses=float(np.mean(over[:, 0] > 1 + MARGIN)),
        over_best=over_best,
        over_least=over_least,
        wins=float(np.mean(over[:, 2] < 1 + SAME)),
    )


def _method(row: FitRow) -> str:
    return row.method


def _least_median(errors: dict[str, list[float]]) -> str:
    return min(errors, key=lambda name: float(np.median(errors[name])))


def _advice(family: Sequence[MethodAt]) -> Advice:
    def best(methods: Sequence[MethodAt]) -> MethodAt:
        return min(methods, key=lambda m: m.workspace_mm.median)

    [joints] = [m for m in family if m.method == INCUMBENT]
    return Advice(family[0].poses, best(family), best([m for m in family if not m.filled]), joints)


def losses(cells: Sequence[MethodAt], advice: Sequence[Advice]) -> list[MethodAt]:
    """Where the best method of a number of poses loses to joints alone, worst first."""
    best = {(own.poses, own.best.method) for own in advice}
    lost = [m for m in cells if (m.poses, m.method) in best and m.loses > 0]
    return sorted(lost, key=lambda m: (-m.loses, -m.over_joints.median))


def _truths(by_seed: Sequence[Sequence[FitRow]]) -> list[TruthAt]:
    cases = grouped([case for rows in by_seed for case in {row.case: 0 for row in rows}], lambda c: c.truth)
    return [
        TruthAt(
            name,
            TRUTH_WORDS[name],
            off_tubes=spread([case.off_tubes for case in own]),
            cad_mm=spread([case.cad_mm for case in own]),
        )
        for name, own in cases.items()
    ]
