"""The study's tables."""

from collections.abc import Mapping

from testbench.studies.real_ur10.readings import SPLITS
from testbench.studies.real_ur10.report import RealReport
from testbench.views.schema import Column, Table

SHORT = {"blocks, realigned": "realigned"}  #: Headings, where the name of a split is long.
MEAN = Column("error.mean_mm", "mean", "mm")
LADDER = (
    Column("model", "model"),
    Column("split", "split"),
    Column("judged", "judged on"),
    Column("poses", "poses that train", form="d"),
    Column("error.n", "poses that judge", form="d"),
    MEAN,
    Column("error.rms_mm", "RMS", "mm"),
    Column("error.p95_mm", "95 %", "mm"),
    Column("error.p99_mm", "99 %", "mm"),
    Column("error.max_mm", "largest", "mm"),
    Column("error.coverage_95", "inside 95 %", "%", ".1f", scale=100),
)
NUMBERS = (
    Column("judged", "judged on"),
    Column("model", "model"),
    Column("poses", "poses", form="d"),
    Column("seeds", "draws", form="d"),
    Column("mean_mm", "mean", "mm"),
    Column("p95_mm", "95 %", "mm"),
    Column("p99_mm", "99 %", "mm"),
    Column("max_mm", "largest", "mm"),
    Column("coverage_95", "inside 95 %", "%", ".1f", scale=100),
)
MODELS = (
    Column("name", "model"),
    Column("words", "what it is"),
    Column("parameters", "unknowns", form="d"),
    Column("conservative", "conservative", form="yes"),
    Column("min_eigenvalue", "smallest eigenvalue", form=".2g"),
    Column("duality_gap", "duality gap", form=".1e"),
)
JOINTS = (
    Column("joint", "joint"),
    *(
        Column(f"{end}_{name}_deg", f"{words} in {name}", "deg", ".0f")
        for name in "AC"
        for end, words in (("low", "least"), ("high", "greatest"))
    ),
    Column("strange_to_A_percent", "poses of C far from A's angles", "%", ".0f"),
    Column("strange_to_C_percent", "poses of A far from C's angles", "%", ".0f"),
)
WAVES = (
    Column("joint", "joint"),
    Column("rms_A_urad", "RMS by A", "urad", ".0f"),
    Column("rms_C_urad", "RMS by C", "urad", ".0f"),
    Column("rms_both_urad", "RMS by both", "urad", ".0f"),
    Column("common_deg", "angles that both visited", "deg", ".0f"),
    Column("alike", "correlation of A and C there", form=".2f"),
)
KNOWN = (
    Column("model", "model"),
    Column("trained", "trained on"),
    Column("judged", "judged on"),
    Column("mean_mm", "prototype", "mm"),
    Column("ours_mm", "here", "mm"),
)


def tables(report: RealReport) -> dict[str, Table]:
    """By name."""
    names = [joint.joint for joint in report.joints]
    springs = [
        Column("trained", "trained on"),
        Column("model", "model"),
        *(Column(f"urad_per_Nm.{k}", name, "urad/(N m)", ".2f") for k, name in enumerate(names)),
    ]
    return {
        "short": _short(report),
        "ladder": Table(LADDER, report.ladder),
        "numbers": Table(NUMBERS, report.by_number),
        "models": Table(MODELS, report.models),
        "joints": Table(JOINTS, report.joints),
        "waves": Table(WAVES, report.joints),
        "compliances": Table(tuple(springs), report.compliances),
        "known": Table(KNOWN, report.known),
    }


def _short(report: RealReport) -> Table:
    """Mean errors, a row a model and a column a split."""
    asked = [name for name in SPLITS if any(line.split == name for line in report.ladder)]
    rows: list[Mapping[str, object]] = [
        {"model": model.name}
        | {name: report.mean(model.name, name) for name in asked if report.has(model.name, name)}
        for model in report.models
    ]
    columns = (Column("model", "model"), *(Column(name, SHORT.get(name, name), "mm") for name in asked))
    return Table(columns, rows, "mean error of positions that were not fitted", headline="blocks")
