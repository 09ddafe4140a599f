"""Every method over the family of true arms and priors, beside others in the same case."""

from collections.abc import Sequence

import numpy as np

from testbench.bench.baselines import JOINTS
from testbench.bench.truths import TRUTH_WORDS, TRUTHS
from testbench.bench.wrong_prior import PRIORS
from testbench.report.table import Row, Trials, merged, paired
from testbench.studies.which_model.trial import CHOSEN
from testbench.trials.spread import SAME, middle

IN_ORDER = {"prior_error": PRIORS, "true_arm": TRUTHS}
"""Words that trials meet in other orders than a reader."""
ERROR = "workspace.rms_mm"  #: What methods are judged by.
MARGIN = 0.05  #: Share by which a method's error must exceed that of joints alone for it to lose.
WORST = 10  #: How many of the worst cases are listed.
FAMILY = f"name {ERROR} check_true.rms_mm over_joints loses over_best over_least best_in misfit conservative"
OF_METHODS = (*FAMILY.split(), "structure", "constraint", "prior", "solved")
WORST_CASES = f"seed true_arm prior_error poses chosen {ERROR} over_joints over_best"


def judged(trials: Trials) -> Trials:
    """Rows by true arm and prior, with errors over those of others in the same case."""
    places = [[list(known).index(word) for word in trials[name]] for name, known in IN_ORDER.items()]
    own = trials.pick(np.lexsort(places))
    keys = list(zip(*(own[name].tolist() for name in ("seed", "true_arm", "poses")), strict=True))
    number_of = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    names, case = own.values("name"), np.array([number_of[key] for key in keys])
    mm = np.empty((len(number_of), len(names)))
    mm[case, [names.index(name) for name in own["name"]]] = own[ERROR]
    fixed, poses = np.delete(mm, names.index(CHOSEN), axis=1), np.array([key[-1] for key in number_of])
    best = np.empty(len(mm))
    for n in own.values("poses"):
        at = poses == n
        best[at] = fixed[at, np.median(fixed[at], axis=0).argmin()]
    joints, best, least = (
        own[ERROR] / np.array([mm[:, names.index(JOINTS)], best, fixed.min(axis=1)])[:, case]
    )
    return own.add(
        case=case,
        over_joints=joints,
        over_best=best,
        over_least=least,
        loses=joints > 1 + MARGIN,
        best_in=least < 1 + SAME,
    )


def gathered(trials: Trials, *by: str) -> list[Row]:
    """Methods at every number of poses, over the cases that are alike in these columns."""
    groups = (*by, "poses", "name")
    counts = [len(own) for _, own in trials.groups(*groups)]
    rows = merged(trials.keep(*OF_METHODS, *groups), *groups)
    return [Row(row, cases=n) for row, n in zip(rows, counts, strict=True)]


def advise(every: Trials, family: Sequence[Row]) -> list[Row]:
    """The default and the fixed methods of least median error, at every number of poses."""
    return [_advice([m for m in family if m.poses == n], every.where(poses=n)) for n in every.values("poses")]


def _advice(family: Sequence[Row], own: Trials) -> Row:
    """At one number of poses: the default, and the fixed methods of least median error."""
    fixed, rows = [m for m in family if m.name != CHOSEN], {m.name: m for m in family}
    plain = [m for m in fixed if not m.prior]
    squares = [m for m in plain if m.constraint == "none" and m.name != JOINTS]
    cases = own.add(seed=own["case"])
    rivals = {"least_squares": _least(squares).name if squares else CHOSEN, "joints": JOINTS}
    return Row(
        poses=family[0].poses,
        default=rows[CHOSEN],
        best=_least(fixed),
        without_prior=_least(plain),
        joints=rows[JOINTS],
        gains=Row({key: paired(cases, CHOSEN, theirs, ERROR) for key, theirs in rivals.items()}),
    )


def _least(rows: Sequence[Row]) -> Row:
    return min(rows, key=lambda m: middle(m.workspace.rms_mm))


def worst_arm(by_arm: Sequence[Row], advice: Row) -> Row:
    """The true arm of the default's largest median error at this number of poses, and others' there."""
    mm = {(m.true_arm, m.name): middle(m.workspace.rms_mm) for m in by_arm if m.poses == advice.poses}
    arm = max((arm for arm, name in mm if name == CHOSEN), key=lambda arm: mm[arm, CHOSEN])
    squares = advice.gains.least_squares
    return Row(
        true_arm=arm,
        poses=advice.poses,
        default_mm=mm[arm, CHOSEN],
        least_squares_mm=mm[arm, squares.theirs] if squares else None,
        joints_mm=mm[arm, JOINTS],
    )


def worst_cases(default: Trials) -> list[Row]:
    """The default's cases of largest error beside joints alone, worst first."""
    own = default.pick(np.argsort(-default["over_joints"], kind="stable")[:WORST])
    return merged(own.keep("case", *WORST_CASES.split()), "case")


def chosen(default: Trials) -> list[Row]:
    """How often the default chose a method."""
    at = {n: len(own) for (n,), own in default.groups("poses")}
    groups = sorted((key, len(own)) for key, own in default.groups("poses", "chosen"))
    return [Row(poses=int(n), chosen=name, cases=own, share=own / at[n]) for (n, name), own in groups]


def true_arms(default: Trials) -> list[Row]:
    """True arms over all trials."""
    once = default.where(poses=default["poses"][0]).keep("true_arm", "off_tubes_percent", "cad_mm")
    return [Row(row, what=TRUTH_WORDS[row.true_arm]) for row in merged(once, "true_arm")]
