"""The report of all trials: every method over the family of truths and priors, beside joints alone."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.rows import UM
from testbench.bench.truths import TRUTHS
from testbench.bench.wrong_prior import PRIORS
from testbench.studies.study import Rows
from testbench.studies.which_model.coverage import coverage
from testbench.studies.which_model.doubts import doubt_table
from testbench.studies.which_model.methods import CHOSEN
from testbench.studies.which_model.report import (
    Advice,
    ChosenAt,
    Gains,
    MethodAt,
    TruthAt,
    WhichModelReport,
    WorstArm,
    WorstAt,
)
from testbench.studies.which_model.rows import Case, FitRow
from testbench.studies.which_model.trial import NAME, RUNS, Settings
from testbench.studies.which_model.words import PRIOR_WORDS, TRUTH_WORDS
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import SAME, grouped, spread

WORST = 10  #: How many of the worst cases are named.
MARGIN = 0.05  #: Share by which a method's error must exceed that of joints alone for it to lose.


@dataclass(frozen=True)
class Judged:
    """A fit, and the errors of others in the same case [mm]."""

    seed: int
    row: FitRow
    joints: float
    best: float  #: Of the fixed method that is best over the family at this number of poses.
    least: float  #: Of any fixed method.


def summary(asked: Settings, seeds: range, trials: Rows[FitRow]) -> WhichModelReport:
    """Medians and spreads over the family, by truth, by prior and by both."""
    by_seed = dict(trials)
    rows = sorted(judged(by_seed), key=lambda own: _places(own.row.case))
    family = gathered(rows, lambda _: ("", ""))
    cells = gathered(rows, lambda row: (row.case.truth, row.case.prior))
    known = [own for own in rows if own.row.filled or own.row.method == CHOSEN]
    every = [own.row for own in rows]
    cover, doubts = coverage(every), doubt_table(every)
    advice = [_advice(own, every) for own in grouped(family, lambda m: m.poses).values()]
    by_truth = gathered(rows, lambda row: (row.case.truth, ""))
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
        stiffer=asked.stiffer,
        advice=advice,
        family=family,
        by_truth=by_truth,
        by_prior=gathered(known, lambda row: ("", row.case.prior)),
        cells=cells,
        losses=losses(cells),
        worst_arm=worst_arm(by_truth, advice[0]),
        worst=worst(rows),
        chosen=_chosen(every),
        cover=cover,
        doubts=doubts,
        truths=_truths(every),
        priors=PRIOR_WORDS,
    )


def judged(by_seed: Mapping[int, Sequence[FitRow]]) -> list[Judged]:
    """Every fit beside the fixed methods of its case: the same trial, truth and number of poses."""
    every = [row for rows in by_seed.values() for row in rows if row.method != CHOSEN]
    best = {
        poses: _least_median({m: [r.workspace_mm for r in same] for m, same in grouped(own, _method).items()})
        for poses, own in grouped(every, lambda row: row.poses).items()
    }
    found = []
    for seed, rows in by_seed.items():
        for (_, poses), own in grouped(rows, lambda row: (row.case.truth, row.poses)).items():
            errors = {row.method: row.workspace_mm for row in own if row.method != CHOSEN}
            beside = errors[JOINTS], errors[best[poses]], min(errors.values())
            found += [Judged(seed, row, *beside) for row in own]
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
        structure=" or ".join(dict.fromkeys(j.row.structure for j in own)),
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


def _advice(family: Sequence[MethodAt], rows: Sequence[FitRow]) -> Advice:
    def best(methods: Sequence[MethodAt]) -> MethodAt:
        return min(methods, key=lambda m: m.workspace_mm.median)

    fixed = [m for m in family if m.method != CHOSEN]
    [joints] = [m for m in fixed if m.method == JOINTS]
    [default] = [m for m in family if m.method == CHOSEN]
    plain = [m for m in fixed if not m.filled]
    errors = {
        name: [row.workspace_mm for row in own]
        for name, own in grouped([row for row in rows if row.poses == family[0].poses], _method).items()
    }

    def gain(theirs: str) -> Gain | None:
        return gained(CHOSEN, theirs, errors[CHOSEN], errors[theirs]) if theirs in errors else None

    gains = Gains(gain(least_squares(plain)), gain(JOINTS))
    return Advice(family[0].poses, default, best(fixed), best(plain), joints, gains)


def least_squares(methods: Sequence[MethodAt]) -> str:
    """The best of least squares that knows no prior, joints alone left out; empty where there is none."""
    own = [m for m in methods if m.constraint == "none" and not m.filled and m.method not in (JOINTS, CHOSEN)]
    return min(own, key=lambda m: m.workspace_mm.median).method if own else ""


def worst_arm(by_truth: Sequence[MethodAt], advice: Advice) -> WorstArm:
    """The true arm of the default's largest median error at this number of poses."""
    own = {(m.truth, m.method): m.workspace_mm.median for m in by_truth if m.poses == advice.poses}
    truth = max((truth for truth, method in own if method == CHOSEN), key=lambda name: own[name, CHOSEN])
    theirs = advice.gains.least_squares
    other = own[truth, theirs.theirs] if theirs else math.nan
    return WorstArm(truth, advice.poses, own[truth, CHOSEN], other, own[truth, JOINTS])


def losses(cells: Sequence[MethodAt]) -> list[MethodAt]:
    """Where the default loses to joints alone, worst first."""
    lost = [m for m in cells if m.method == CHOSEN and m.loses > 0]
    return sorted(lost, key=lambda m: (-m.loses, -m.over_joints.median))


def worst(rows: Sequence[Judged]) -> list[WorstAt]:
    """The cases in which the default's error is largest beside that of joints alone."""
    own = [j for j in rows if j.row.chosen is not None]
    found = [
        WorstAt(
            j.seed,
            j.row.case.truth,
            j.row.case.prior,
            j.row.poses,
            chosen=str(j.row.chosen),
            workspace_mm=j.row.workspace_mm,
            over_joints=j.row.workspace_mm / j.joints,
            over_best=j.row.workspace_mm / j.best,
        )
        for j in own
    ]
    return sorted(found, key=lambda case: -case.over_joints)[:WORST]


def _chosen(rows: Sequence[FitRow]) -> list[ChosenAt]:
    own = [row for row in rows if row.chosen is not None]
    at = grouped(own, lambda row: row.poses)
    groups = grouped(own, lambda row: (row.poses, str(row.chosen)))
    return [ChosenAt(*key, len(same), len(same) / len(at[key[0]])) for key, same in sorted(groups.items())]


def _truths(rows: Sequence[FitRow]) -> list[TruthAt]:
    cases = grouped(dict.fromkeys(row.case for row in rows), lambda case: case.truth)
    return [
        TruthAt(
            name,
            TRUTH_WORDS[name],
            off_tubes=spread([case.off_tubes for case in own]),
            cad_mm=spread([case.cad_mm for case in own]),
        )
        for name, own in cases.items()
    ]
