"""The tables of identifiability: methods, poses, scales, the choice of a structure, coverage."""

from collections.abc import Iterable, Mapping

from testbench.bench.baselines import distinct
from testbench.studies.identifiability.summary import IdentifiabilityReport
from testbench.views.schema import Column, Table

WORKSPACE = Column("workspace.rms_mm", "RMS workspace", "mm")
MODELS = (
    Column("name", "model"),
    Column("parameters", "unknowns", form="d"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes"),
    Column("uncertainty_percent", "uncertainty of the prior", "%", ".0f"),
    Column("check.rms_mm", "RMS check, readings", "mm"),
    Column("check_true.rms_mm", "RMS check, true", "mm"),
    WORKSPACE,
    Column("workspace.max_mm", "max workspace", "mm"),
)
"""At the check poses against readings and against the truth, over the workspace against the truth."""
SHORT = (
    Column("name", "model"),
    Column("linear.conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("linear.workspace.rms_mm", "RMS workspace", "mm", short="RMS work-\nspace mm"),
    Column("nonlinear.workspace.rms_mm", "non-linear truth", "mm", short="non-linear\ntruth mm"),
)
CHOICE = (
    Column("name", "structure"),
    Column("chosen", "recommended", form="yes"),
    Column("held_out_f_m", "F_M held out", form=".2f"),
    Column("workspace_mm", "RMS workspace", "mm"),
)
COVERAGE = (
    Column("name", "interval"),
    Column("datasets", "datasets", form="d"),
    Column("covered", "covered", "%", ".1f", scale=100),
    Column("standard_error", "standard error", "%", ".1f", scale=100),
    Column("width_um", "mean width", "um", ".0f"),
    Column("unbounded", "unbounded", "%", ".0f", scale=100),
)
DUELS = (
    Column("ours", "model"),
    Column("theirs", "against"),
    Column("seeds", "seeds", form="d"),
    Column("workspace", "better over the workspace", form="d"),
    Column("alike", "alike", form="d"),
    Column("ratio", "error over its", form=".2f"),
    Column("check", "better at check poses", form="d"),
)
POSES, SCALE = (
    Column("poses", "poses", form="g"),
    Column("scale", "prior softer than the truth, times", form="g"),
)


def rms(name: str) -> Column:
    """Error over the workspace of a model, where something is varied."""
    return Column(name, name, "mm")


def tables(report: IdentifiabilityReport) -> dict[str, Table]:
    """Every table of report.md, and the one for 80 columns."""
    told = {m.name for m in (*distinct(report.models), *distinct(report.nonlinear))}
    pairs = [own for own in zip(report.models, report.nonlinear, strict=True) if own[0].name in told]
    choice = report.choice
    return {
        "models": Table(MODELS, report.models),
        "nonlinear": Table(MODELS, report.nonlinear),
        "short": Table(SHORT, [{"name": a.name, "linear": a, "nonlinear": b} for a, b in pairs]),
        "duels": Table(DUELS, report.duels),
        "duels_nonlinear": Table(DUELS, report.duels_nonlinear),
        "poses": _swept(POSES, report.poses),
        "scales": _swept(SCALE, report.scales),
        "choice": Table(
            CHOICE,
            [
                {
                    "name": name,
                    "chosen": share,
                    "held_out_f_m": choice.held_out_f_m[name],
                    "workspace_mm": choice.workspace_mm[name],
                }
                for name, share in choice.chosen.items()
            ],
        ),
        "coverage": Table(COVERAGE, [*report.coverage.values(), *report.family_coverage.values()]),
    }


def _swept(x: Column, rows: Iterable[Mapping[str, object]]) -> Table:
    rows = list(rows)
    return Table((x, *(rms(name) for name in rows[0] if name != x.key)), rows)
