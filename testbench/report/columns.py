"""The quantities of tables, each declared once: key, heading, unit, format."""

from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.views.schema import Column

ROUNDING_UM = 1e-3  #: Errors below are rounding.
READINGS = "RMS\ncheck\nread-\nings\nmm"
EVERY = (
    Column("name", "model"),
    Column("method", "method"),
    Column("status", "status"),
    Column("true_arm", "true arm", called=CALLED),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", short="conser-\nvative"),
    Column("f_m", "F_M", form=".2f"),
    Column("f_m_floor", "floor", form=".2f", exact=True),
    Column("duality_gap", "duality gap", form=".1e"),
    Column("f_m_excess_bound", "trace weight costs at most", form=".1e"),
    Column("min_eigenvalue", "smallest eigenvalue", form=".1e"),
    Column("solve_seconds", "time", "s"),
    Column("identification.rms_mm", "RMS fit", "mm", paper="identification_rms_mm"),
    Column("check.rms_mm", "RMS check, readings", "mm", paper="check_rms_mm", short=READINGS),
    Column("check.p95_mm", "95 % check, readings", "mm"),
    Column("check.max_mm", "max check, readings", "mm", paper="check_max_mm"),
    Column("check.max_relative_percent", "max rel.", "%", ".2f", paper="check_max_relative_percent"),
    Column("check_true.rms_mm", "RMS check, true", "mm"),
    Column("workspace.rms_mm", "RMS workspace, true", "mm", short="RMS\nwork-\nspace\ntrue\nmm"),
    Column("times_less", "times less than LS", form=".2f", short="times\nless\nthan\nLS"),
    *(
        Column(f"residuals.{group}.{key}", f"{heading}, {group}", unit, form)
        for group in ("identification", "check")
        for key, heading, unit, form in (
            ("mean_um", "residual mean", "um", ".1f"),
            ("std_um", "residual standard deviation", "um", ".1f"),
            ("lilliefors_p", "Lilliefors p", "", ".2f"),
        )
    ),
    Column("ours", "model"),
    Column("theirs", "against"),
    Column("ours_mm", "its error", "mm"),
    Column("theirs_mm", "the other's", "mm"),
    Column("times", "the other's over its", form=".2f"),
    Column("won", "better in", form="yes"),
    # Models by cases of a factor: noise, instruments, disturbances
    Column("truth", "truth"),
    Column("rms_um", "RMS error", "um", ".2f", rounding=ROUNDING_UM),
    Column("p95_um", "95 % error", "um", ".1f", rounding=ROUNDING_UM),
    Column("sigma_um", "noise of a reading", "um", "g"),
    Column("noise_free_um", "error without noise", "um", ".1f", rounding=ROUNDING_UM),
    Column("um_per_um", "cost of a um of noise", "um", ".2f"),
    Column("ratio", "its error over the other's", form=".2f"),
    Column("tied", "alike in", form="yes"),
    Column("instrument", "instrument"),
    Column("distance_m", "distance", "m", "g"),
    Column("case", "disturbance", called={"none": "no disturbance"}),
    Column("moved_um", "moves deflections by", "um", ".0f"),
    Column("added_um", "adds to the error", "um", "+.0f"),
    Column("true_change_percent", "error changes, true", "%", "+.1f"),
    Column("true_within", "within the claim, true", form="yes"),
    Column("read_change_percent", "changes, against readings", "%", "+.1f"),
    Column("read_within", "within the claim, against readings", form="yes"),
)  # fmt: skip
"""Of rows and of report.json; a study adds its own here."""
KNOWN = {column.key: column for column in EVERY}


def columns(keys: str, *, paper: bool = True) -> tuple[Column, ...]:
    """Columns by their keys, blanks between; with the paper's numbers where they have such."""
    found = tuple(KNOWN[key] for key in keys.split())
    return found if paper else tuple(replace(column, paper="") for column in found)
