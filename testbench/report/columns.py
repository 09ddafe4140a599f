"""The quantities of tables, each declared once: key, heading, unit, format."""

from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.views.schema import Column

ROUNDING_UM, ROUNDING_PERCENT = 1e-3, 1e-5  #: Errors below are rounding.
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
    # a hung weight: Eq. (6) and (7)
    Column("prediction", "prediction"),
    Column("load_N", "load", "N", ".4g"),
    Column("deflection_rms_mm", "deflection RMS", "mm", ".2f"),
    Column("rms_um", "RMS error", "um", ".2f", rounding=ROUNDING_UM),
    Column("vertical_rms_um", "vertical RMS error", "um", ".2f", rounding=ROUNDING_UM),
    Column("error_um", "error of the tool", "um", ".2f", rounding=ROUNDING_UM),
    Column("max_um", "largest error", "um", ".2f", rounding=ROUNDING_UM),
    Column("rms_percent", "RMS error", "%", ".2f", rounding=ROUNDING_PERCENT),
    Column("error_percent", "error of the tool", "%", ".2f", rounding=ROUNDING_PERCENT),
    Column("max_percent", "largest error", "%", ".2f", rounding=ROUNDING_PERCENT),
    Column("tangent_difference_ppm", "largest difference", "ppm"),
    # solvers of Eq. (19)
    Column("key", "solver"),
    Column("solver", "solver"),
    Column("relative_excess", "over (d)", form=".1e", rounding=1e-12, short="over\n(d)"),
    Column("relative_excess_bound", "over the bound", form=".1e", short="over\nthe\nbound"),
    Column("seconds", "time", "s", ".3g"),
    Column("seconds_to_1_percent", "time to 1 %", "s", ".3g", short="to\n1 %\ns"),
    Column("ratio_to_conic", "to 1 %, times (d)", form=".3g", short="to 1 %\nx (d)"),
    Column("whole_ratio_to_conic", "whole time, times (d)", form=".3g"),
    Column("evaluations", "F_M evaluations", form=".0f"),
    Column("local_solves", "local solves", form="d"),
    Column("local_solves_elsewhere", "of them elsewhere", form="d"),
    Column("starts", "random starts", form="d"),
    Column("reference", "excess is over"),
    Column("within_1e_6_percent", "within 10^-6", "%", ".0f"),
    Column("within_1e_5_percent", "within 10^-5", "%", ".0f"),
    Column("median_excess", "median excess", form=".1e"),
    Column("worst_excess", "worst excess", form=".1e"),
    Column("unfinished", "out of steps", form="d"),
    Column("cap_excess", "cap costs", form=".1e"),
    # readings of a real arm: series A and C
    Column("words", "what it is"),
    Column("split", "split"),
    Column("judged", "judged on"),
    Column("trained", "trained on"),
    Column("fit", "fit"),
    Column("poses", "poses", form="d"),
    Column("draws", "draws", form="d"),
    Column("blocks_mm", "blocks", "mm"),
    Column("a_to_c_mm", "A to C", "mm"),
    Column("c_to_a_mm", "C to A", "mm"),
    Column("realigned_mm", "realigned", "mm"),
    Column("error.n", "poses that judge", form="d"),
    Column("error.mean_mm", "mean error", "mm"),
    Column("error.rms_mm", "RMS", "mm"),
    Column("error.p95_mm", "95 %", "mm"),
    Column("error.p99_mm", "99 %", "mm"),
    Column("error.max_mm", "largest", "mm"),
    Column("error.inside_95_percent", "inside 95 %", "%", ".1f"),
    Column("joint", "joint"),
    *(
        Column(f"{end}_{name}_deg", f"{words} in {name}", "deg", ".0f")
        for name in "AC"
        for end, words in (("low", "least"), ("high", "greatest"))
    ),
    Column("strange_to_A_percent", "poses of C far from A's angles", "%", ".0f"),
    Column("strange_to_C_percent", "poses of A far from C's angles", "%", ".0f"),
    *(Column(f"rms_{by}_urad", f"RMS by {by}", "urad", ".0f") for by in ("A", "C", "both")),
    Column("common_deg", "angles that both visited", "deg", ".0f"),
    Column("correlation", "correlation of A and C there", form=".2f"),
    Column("urad_per_Nm", "compliance", "urad/(N m)", ".2f"),
    Column("prototype_mm", "prototype", "mm"),
    Column("here_mm", "here", "mm"),
    # absolute readings: what hides in what, and what lies in its interval
    Column("arm", "arm"),
    Column("campaign", "campaign"),
    Column("trials", "trials", form="d"),
    Column("readings", "readings", form="d"),
    Column("error_mm", "error, own weight", "mm"),
    Column("loaded_mm", "error, payload", "mm"),
    Column("over_optimum", "over the optimum", form=".2f"),
    *(
        Column(f"{key}_{joint}_percent", f"c{joint} off, {words}", "%", ".1f")
        for joint in (2, 3)
        for key, words in (("bias", "median"), ("off", "RMS"))
    ),
    Column("geometry_off", "geometry off", "mm, mrad"),
    *(
        Column(f"inside.{part}_percent", f"{words} inside", "%", ".1f")
        for part, words in (
            ("positions", "positions"),
            ("geometry", "geometry"),
            ("joint_errors", "joint errors"),
            ("joints", "joint compliances"),
            ("entries", "entries of C"),
        )
    ),
    Column("gears_kept_percent", "joint errors kept", "%", ".1f"),
    Column("links_kept_percent", "links kept", "%", ".1f"),
    # jobs of a corrected robot
    Column("job", "job"),
    Column("removed_percent", "removed", "%", ".1f"),
    Column("worst_percent", "worst case", "%", ".1f"),
    Column("nine_percent", "cases with 90 % or more removed", "%", ".1f"),
    Column("worse", "cases made worse", form="d"),
    Column("before.median_mm", "before", "mm"),
    Column("after.median_mm", "after", "mm"),
    Column("after.p95_mm", "after, 95th percentile", "mm"),
    Column("after.most_mm", "after, largest", "mm"),
    Column("covered_percent", "covered", "%", ".1f"),
    Column("by_trial_percent", "median removed, trial by trial", "%", ".1f"),
    Column("median_kept", "trials with a median of 97 %", form="yes"),
    Column("nine_kept", "trials with 90 % removed in 95 % of points", form="yes"),
    Column("trials_worse", "trials with a point made worse", form="d"),
    Column("covered_by_trial_percent", "covered, trial by trial", "%", ".1f"),
    Column("solved", "solved", form="yes"),
    Column("unseen_percent", "without bound", "%", ".1f"),
    Column("buckled", "trials without equilibrium", form="d"),
)  # fmt: skip
"""Of rows and of report.json; a study adds its own here."""
KNOWN = {column.key: column for column in EVERY}


def columns(keys: str, *, paper: bool = True) -> tuple[Column, ...]:
    """Columns by their keys, blanks between; with the paper's numbers where they have such."""
    found = tuple(KNOWN[key] for key in keys.split())
    return found if paper else tuple(replace(column, paper="") for column in found)
