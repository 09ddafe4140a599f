"""The columns of the study of the default method, and its tables."""

from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.bench.wrong_prior import PRIORS_CALLED
from testbench.studies.which_model.methods import CHOSEN
from testbench.studies.which_model.report import MethodAt, WhichModelReport
from testbench.views.colours import CHOICE, Look, look
from testbench.views.schema import Column, Table, pivot

METHOD = Column("method", "method")
TRUTH = Column("truth", "true arm", called=CALLED)
PRIOR = Column("prior", "prior", called=PRIORS_CALLED)
POSES = Column("poses", "poses", form="d")
ACROSS = replace(POSES, unit="poses")
ERROR = Column("workspace_mm", "RMS error", "mm", ".3f")
OVER_BEST = Column("over_best", "over the best fixed", form=".2f")
FAMILY = (
    METHOD,
    ERROR,
    Column("check_mm", "at check poses", "mm", ".3f"),
    Column("over_joints", "over joints alone", form=".2f"),
    Column("loses", "loses to them", form="yes"),
    OVER_BEST,
    Column("over_least", "over the best of the case", form=".2f"),
    Column("wins", "is the best in", form="yes"),
    Column("misfit", "F_M over floor", form=".2f"),
    Column("conservative", "conservative", form="yes"),
)
WHERE = Column("where", "cases")
COVERED = Column("covered", "covered", "%", ".1f", scale=100)
OVER_IDEAL = Column("over_ideal", "half width over the ideal", form=".2f")
COVER = (
    WHERE,
    Column("cases", "how many", form="d"),
    COVERED,
    Column("by_case", "covered, case by case", "%", ".1f", scale=100),
    Column("half_mm", "half width", "mm", ".3f"),
    Column("ideal_mm", "of the ideal", "mm", ".3f"),
    OVER_IDEAL,
)
LOSSES = (
    TRUTH,
    PRIOR,
    POSES,
    METHOD,
    Column("cases", "cases", form="d"),
    Column("loses", "loses", form="yes"),
    Column("over_joints", "over joints alone", form=".2f"),
    ERROR,
)
WORST = (
    Column("trial", "trial", form="d"),
    TRUTH,
    PRIOR,
    POSES,
    Column("chosen", "chosen"),
    ERROR,
    Column("over_joints", "over joints alone", form=".2f"),
    OVER_BEST,
)
CHOICES = (POSES, METHOD, Column("cases", "cases", form="d"), Column("share", "share", form="yes"))
DOUBTS = (
    PRIOR,
    Column("what", "which cases"),
    Column("cases", "how many", form="d"),
    Column("doubted", "any doubt", form="yes"),
    Column("told", "what is wrong is contradicted", form="yes"),
    Column("unchecked", "is named as unchecked", form="yes"),
    Column("otherwise", "where another one is wrong", form="yes"),
    Column("either", "contradicted or unchecked", form="yes"),
)
TRUTHS = (
    TRUTH,
    Column("what", "what it is"),
    Column("off_tubes", "off tubes", "%", ".0f", scale=100),
    Column("cad_mm", "error of the folder's values", "mm", ".3f"),
)


def look_of(method: MethodAt) -> Look:
    """How a method is drawn."""
    if method.method == CHOSEN:
        return CHOICE
    return look(method.structure, method.constraint, method.filled)


def tables(report: WhichModelReport) -> dict[str, Table]:
    """Methods by poses over the family, by truth and by prior; where the default loses, and what it says."""
    family = Table((), report.family, "RMS error over the workspace, mm")
    found = {
        "family": pivot(family, METHOD, ACROSS, ERROR),
        "family_short": replace(
            pivot(family, METHOD, ACROSS, replace(ERROR, exact=True)),
            looks={m.method: look_of(m) for m in report.family},
        ),
        "losses": Table(LOSSES, report.losses),
        "truths": Table(TRUTHS, report.truths),
        "worst": Table(WORST, report.worst),
        "chosen": Table(CHOICES, report.chosen),
        "doubts": Table(DOUBTS, [own for own in report.doubts if own.poses is None]),
        "cover": Table(COVER, [own for own in report.cover if own.method == CHOSEN]),
        "covered": pivot(
            Table((), report.cover), WHERE, METHOD, replace(COVERED, unit="", form=".3f", scale=1)
        ),
        "widths": pivot(Table((), report.cover), WHERE, METHOD, replace(OVER_IDEAL, exact=True)),
    }
    for own in report.advice:
        at = own.poses
        found[f"family_{at}"] = Table(FAMILY, _at(report.family, at), bold=CHOSEN)
        for name, rows, across in (("truth", report.by_truth, TRUTH), ("prior", report.by_prior, PRIOR)):
            table = Table((), _at(rows, at), bold=CHOSEN)
            found[f"{name}_{at}"] = pivot(table, METHOD, across, replace(ERROR, exact=True))
        cells = Table((), [m for m in _at(report.cells, at) if m.method == CHOSEN])
        found[f"default_{at}"] = pivot(cells, TRUTH, PRIOR, ERROR)
        found[f"over_best_{at}"] = pivot(cells, TRUTH, PRIOR, OVER_BEST)
    return found


def _at(rows: list[MethodAt], poses: int) -> list[MethodAt]:
    return [m for m in rows if m.poses == poses]
