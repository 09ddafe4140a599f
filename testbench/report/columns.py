"""The quantities of tables, each declared once: key, heading, unit, format."""

from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.views.schema import Column

READINGS = "RMS\ncheck\nread-\nings\nmm"
SI = "10^-6 SI"  #: Eigenvalues of a compliance are in mixed SI units, as the paper's.
EVERY = (
    Column("name", "model"),
    Column("method", "method"),
    Column("status", "status"),
    Column("true_arm", "true arm", called=CALLED),
    Column("parameters", "unknowns", form="d", short="un-\nknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", paper="conservative", short="conser-\nvative"),
    Column("f_m", "F_M", form=".3f", paper="f_m"),
    Column("f_m_floor", "floor", form=".3f", exact=True),
    Column("duality_gap", "duality gap", form=".1e"),
    Column("f_m_excess_bound", "trace weight costs at most", form=".1e"),
    Column("min_eigenvalue", "smallest eigenvalue", form=".1e"),
    Column("solve_seconds", "time", "s"),
    Column("identification.rms_mm", "RMS fit", "mm", paper="identification_rms_mm"),
    Column("check.rms_mm", "RMS check, readings", "mm", paper="check_rms_mm", short=READINGS),
    Column("check.p95_mm", "95 % check, readings", "mm", paper="check_p95_mm", short=f"95 %{READINGS[3:]}"),
    Column("check.max_mm", "max check, readings", "mm", paper="check_max_mm"),
    Column("check.max_relative_percent", "max rel.", "%", ".2f", paper="check_max_relative_percent"),
    Column("check_true.rms_mm", "RMS check, true", "mm"),
    Column("workspace.rms_mm", "RMS workspace, true", "mm", short="RMS\nwork-\nspace\ntrue\nmm"),
    Column("times_less", "times less than LS", form=".3g", short="times\nless\nthan\nLS"),
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
    # an arm that is checked
    Column("number", "number"),
    Column("hangs_percent", "share of the sag that hangs on it", "%", ".0f"),
    Column("sag_share_percent", "its share of the sag", "%", ".1f"),
    # Full poses of section 5.2
    Column("check_true.p95_mm", "95 % check, true", "mm", short="95 %\ncheck\ntrue\nmm"),
    Column("check.p95_relative_percent", "95 % rel.", "%", ".2f"),
    Column("check_true.max_relative_percent", "max rel., true", "%", ".2f"),
    # The order m of the vector space, Eq. (16)
    Column("m", "order m", form="d"),
    Column("f_m_over_optimum", "F_M over optimum", form=".5f"),
    Column("block_rank", "largest rank of a block", form=".0f"),
    Column("min_scaled_eigenvalue", "smallest scaled eigenvalue", form=".1e", rounding=1e-12),
    # Conservative by constraint, or by a choice among equal fits: seeds
    Column("truth", "truth"),
    Column("seeds", "seeds", form="d"),
    Column("free", "directions free", form="d"),
    Column("also_conservative", "conservative solution of MLS56's fit", form="d"),
    Column("fits_as_well", "F_M of MGCO56 no higher", form="d"),
    Column("excess_percent", "F_M above the optimum", "%", ".2f"),
    Column("reaches_optimum", "reaches the optimum", form="yes"),
    Column("rms_to_eq_23_over_sigma", "RMS distance to Eq. (23)", "sigma/load", ".2f"),
    # One compliance of section 5.1 beside the true one, and beside the printed one
    *(
        Column(key, heading, unit, form, paper=key, short=short)
        for key, heading, unit, form, short in (
            ("symmetric", "symmetric", "", "yes", "sym-\nmetric"),
            ("negative_eigenvalue_matrix", "eigenvalue below 0", "", "yes", "eigen-\nvalue\nbelow 0"),
            ("negative_eigenvalue", "of symmetric part below 0", "", "yes", "of sym.\npart"),
            ("matrix_eigenvalue_micro", "smallest eigenvalue", SI, ".3f", f"smallest\n{SI}"),
            ("symmetric_eigenvalue_micro", "smallest of symmetric part", SI, ".3f", f"of sym.\npart\n{SI}"),
            ("prediction.position_rms_um", "position error", "um", ".1f", ""),
            ("prediction.position_relative_percent", "of the deflection", "%", ".2f", "%"),
            ("prediction.rotation_rms_urad", "rotation error", "urad", ".0f", ""),
            ("prediction.rotation_relative_percent", "of the rotation", "%", ".2f", "%"),
            *(
                (f"entries.{key}", heading, unit, ".2f", f"{short}\n{unit}")
                for key, heading, unit, short in (
                    ("translation_rms_um_per_N", "C force-position", "um/N", "force\npos."),
                    ("coupling_translation_rms_um_per_Nm", "C moment-position", "um/(N m)", "moment\npos."),
                    ("coupling_rotation_rms_urad_per_N", "C force-rotation", "urad/N", "force\nrot."),
                    ("rotation_rms_urad_per_Nm", "C moment-rotation", "urad/(N m)", "moment\nrotation"),
                )
            ),
        )
    ),
    # Any numbers, a line each
    Column("what", "what"),
    Column("value", "value", form=".3g"),
    # Statements of the paper
    Column("claim", "statement"),
    Column("verdict", "verdict"),
    Column("why", "why"),
)  # fmt: skip
"""Of rows and of report.json; a study adds its own here."""
KNOWN = {column.key: column for column in EVERY}


def columns(keys: str, *, paper: bool = True) -> tuple[Column, ...]:
    """Columns by their keys, blanks between; with the paper's numbers where they have such."""
    found = tuple(KNOWN[key] for key in keys.split())
    return found if paper else tuple(replace(column, paper="") for column in found)
