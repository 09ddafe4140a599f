"""The tables of section 5.2: columns declared once for terminal, report.md, figure and recording."""

from testbench.studies.paper import CLAIMS
from testbench.studies.six_dof_arm.report import SixDofReport
from testbench.trials.spread import middle
from testbench.views.schema import Column, Table

CELLS = (
    Column("check.p95_mm", "95 % check", "mm", paper="check_p95_mm", short="95 %\ncheck\nmm"),
    Column(
        "check.max_relative_percent",
        "max check",
        "%",
        ".2f",
        paper="check_max_relative_percent",
        short="max\ncheck\n%",
    ),
)
"""The cells of Table II that the paper's text gives."""
COLUMNS = (
    Column("name", "model"),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("f_m", "F_M", form=".3f"),
    Column("f_m_floor", "floor", form=".3f", exact=True),
    CELLS[0],
    Column("check_true.p95_mm", "95 % true", "mm", short="95 %\ntrue\nmm"),
    Column("check.rms_mm", "RMS check", "mm"),
    Column("check_true.rms_mm", "RMS true", "mm"),
    Column("check.p95_relative_percent", "95 % check", "%", ".2f"),
    CELLS[1],
    Column("check_true.max_relative_percent", "max true", "%", ".2f", short="max\ntrue\n%"),
    Column("times_less", "times less than LS", form=".3g", short="times\nless\nthan\nLS"),
)
"""Tables I and II; errors against the readings of the check runs, and of the same runs without noise."""
SHORT = (
    "name",
    "conservative",
    "check.p95_mm",
    "check_true.p95_mm",
    "check.max_relative_percent",
    "times_less",
)
HEADLINE = "check_true.p95_mm"  #: What the answer speaks of.
RECORDED = ("name", "conservative", "check_true.p95_mm", "times_less")
"""What a terminal of 80 columns has room for, and what a recording says first."""
ORDERS = (
    Column("m", "m", form="d"),
    Column("f_m", "F_M", form=".4g"),
    Column("f_m_over_optimum", "F_M over optimum", form=".5f"),
    Column("rank", "largest rank", form=".0f"),
    Column("min_scaled_eigenvalue", "smallest scaled eigenvalue", form=".1e", rounding=1e-12),
    Column("check_true.p95_mm", "95 % true", "mm"),
)
TIES = (
    Column("truth", "truth"),
    Column("seeds", "seeds", form="d"),
    Column("free", "directions free", form="d"),
    Column("conservative", "conservative solution of MLS56's fit", form="d"),
    Column("fits_as_well", "F_M of MGCO56 no higher", form="d"),
)
"""In how many seeds."""


def tables(report: SixDofReport) -> dict[str, Table]:
    """Both truths, the order m, the paper's statements."""
    mark = report.best[0] if len(report.best) == 1 else ""
    short = tuple(c for c in COLUMNS if c.key in ("name", *SHORT))
    bent = [vars(m) | {"paper": None} for m in report.nonlinear.models]
    plain, plain_short = (tuple(c for c in own if c.key != "times_less") for own in (COLUMNS, short))
    recorded = tuple(c for c in COLUMNS if c.key in RECORDED)
    best_first = sorted(report.models, key=lambda m: middle(m.check_true.p95_mm))
    errors = (COLUMNS[0], *(c for c in COLUMNS if c.key.startswith("check_true.") and c.unit == "mm"))
    return {
        "linear": Table(COLUMNS, report.models, bold=mark),
        "nonlinear": Table(plain, bent),
        "recorded": Table(recorded, best_first, bold=mark),
        "short": Table(short, report.models, "linear truth, as in the paper", mark, headline=HEADLINE),
        "short_nonlinear": Table(plain_short, bent, "MuJoCo's non-linear truth", headline=HEADLINE),
        "errors": Table(errors, report.models, bold=mark),
        "MGCO69": Table(ORDERS, report.order.MGCO69),
        "MGCO56": Table(ORDERS, report.order.MGCO56),
        "ties": Table(TIES, report.ties),
        "claims": Table(CLAIMS, report.claims),
    }
