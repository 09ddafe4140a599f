"""The columns of the study of the default method, and its tables."""

from dataclasses import replace

from testbench.studies.which_model.report import MethodAt, WhichModelReport
from testbench.views.schema import Column, Table, pivot

METHOD = Column("method", "method")
TRUTH = Column("truth", "truth")
PRIOR = Column("prior", "prior")
POSES = Column("poses", "poses", form="d")
ACROSS = replace(POSES, unit="poses")
ERROR = Column("workspace_mm", "RMS error", "mm", ".3f")
FAMILY = (
    METHOD,
    ERROR,
    Column("check_mm", "at check poses", "mm", ".3f"),
    Column("over_joints", "over joints alone", form=".2f"),
    Column("loses", "loses to them", form="yes"),
    Column("over_best", "over the best fixed", form=".2f"),
    Column("over_least", "over the best of the case", form=".2f"),
    Column("wins", "is the best in", form="yes"),
    Column("misfit", "F_M over floor", form=".2f"),
    Column("conservative", "conservative", form="yes"),
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
TRUTHS = (
    TRUTH,
    Column("what", "what it is"),
    Column("off_tubes", "off tubes", "%", ".0f", scale=100),
    Column("cad_mm", "error of the folder's values", "mm", ".3f"),
)


def tables(report: WhichModelReport) -> dict[str, Table]:
    """Methods by poses over the family, by truth and by prior; where the best loses."""
    family = Table((), report.family, "RMS error over the workspace, mm")
    found = {
        "family": pivot(family, METHOD, ACROSS, ERROR),
        "family_short": pivot(family, METHOD, ACROSS, replace(ERROR, exact=True)),
        "losses": Table(LOSSES, report.losses),
        "truths": Table(TRUTHS, report.truths),
    }
    for own in report.advice:
        at, best = own.poses, own.best.method
        found[f"family_{at}"] = Table(FAMILY, _at(report.family, at), bold=best)
        for name, rows, across in (("truth", report.by_truth, TRUTH), ("prior", report.by_prior, PRIOR)):
            table = Table((), _at(rows, at), bold=best)
            found[f"{name}_{at}"] = pivot(table, METHOD, across, replace(ERROR, exact=True))
        cells = [m for m in _at(report.cells, at) if m.method == best]
        found[f"best_{at}"] = pivot(Table((), cells), TRUTH, PRIOR, ERROR)
    return found


def _at(rows: list[MethodAt], poses: int) -> list[MethodAt]:
    return [m for m in rows if m.poses == poses]
