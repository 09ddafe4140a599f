"""The quantities of tables, each declared once: key, heading, unit, format."""

from dataclasses import replace

from testbench.campaign.perturbed_prior import PRIORS_CALLED
from testbench.campaign.true_arms import CALLED
from testbench.views.schema import Column

ROUNDING_UM = 1e-3  #: Errors below are rounding.
READINGS = "RMS check\nreadings\nmm"
SI = "10^-6 SI"  #: Eigenvalues of a compliance are in mixed SI units, as the paper's.
WORDS = """
    method status interval quantity values rows number truth what verdict why prediction
    solver split fit joint load way unit instrument arm campaign series
"""
COUNTS = "datasets seeds local_solves poses draws run task line pose seed cases trials readings row"
"""Keys of words and of counts that are their own headings."""
DECLARED = (
    *(Column(key, key.replace("_", " ")) for key in WORDS.split()),
    *(Column(key, key.replace("_", " "), form="d") for key in COUNTS.split()),
    Column("name", "model"),
    Column("true_arm", "true arm", called=CALLED),
    Column("parameters", "unknowns", form="d", short="unknowns"),
    Column("rank", "seen", form=".0f", exact=True),
    Column("conservative", "conservative", form="yes", paper="conservative", short="conservative"),
    Column("f_m", "F_M", form=".3f", paper="f_m"),
    Column("f_m_floor", "floor", form=".3f", exact=True),
    Column("failed", "failed"),
    Column("duality_gap", "duality gap", form=".1e"),
    Column("f_m_excess_bound", "trace weight costs at most", form=".1e"),
    Column("min_eigenvalue", "smallest eigenvalue", form=".1e"),
    Column("identification.rms_mm", "RMS fit", "mm", paper="identification_rms_mm"),
    Column("check.rms_mm", "RMS check, readings", "mm", paper="check_rms_mm", short=READINGS),
    Column("check.p95_mm", "95 % check, readings", "mm", paper="check_p95_mm", short=f"95 %{READINGS[3:]}"),
    Column("check.max_mm", "max check, readings", "mm", paper="check_max_mm"),
    Column("check.max_relative_percent", "max rel.", "%", ".2f", paper="check_max_relative_percent"),
    Column("check_true.rms_mm", "RMS check, true", "mm"),
    Column("workspace.rms_mm", "RMS workspace, true", "mm", short="RMS\nworkspace\ntrue, mm"),
    Column("times_less", "times smaller than LS", form=".2f", short="times\nsmaller\nthan\nLS"),
    Column("ours", "model"),
    Column("theirs", "against", called={"joints alone": "joint stiffness only"}),
    Column("times", "the other's over its", form=".2f"),
    # a map of noise by poses: GCO beside others, fit by fit
    Column("cell", "structure and poses"),
    Column("level", "expected error"),
    Column("sigma_um", "noise of a reading", "um", "g"),
    Column("fits_share", "of the fits", form="yes"),
    # with and without a prior: what is varied, pairs of models, a choice, intervals
    Column("uncertainty_percent", "uncertainty of the prior", "%", ".0f"),
    Column("nonlinear.workspace.rms_mm", "non-linear truth", "mm", short="non-linear\ntruth mm"),
    Column("nonlinear.check_true.p95_mm", "95 % non-linear truth", "mm", short="95 %\nnon-linear\nmm"),
    Column("scale", "prior softer than the truth, times", form="g"),
    Column("wins", "better over the workspace", form="d"),
    Column("ratio", "its error over the other's", form=".2f"),
    Column("f_m_held_out", "F_M held out", form=".2f"),
    Column("standard_error_percent", "standard error", "%", ".1f"),
    Column("width_um", "mean width", "um", ".0f"),
    Column("unbounded_percent", "unbounded", "%", ".0f"),
    # a file of measured runs
    Column("file_columns", "columns of the file"),
    # models of one's own runs
    Column("intervals.half_width_mm", "+- (95 %)", "mm"),
    Column("elsewhere.half_width_mm", "+- (95 %) over the workspace", "mm"),
    Column("elsewhere.apart_mm", "from the model to take, over the workspace", "mm"),
    Column("which_run", "run"),
    Column("moved_mm", "deflection", "mm"),
    Column("taken_mm", "residual", "mm"),
    Column("told_percent", "told by the readings", "%", ".0f"),
    Column("decided_by_prior", "unknowns that the prior decides", form="d"),
    Column("stiffer_percent", "stiffer per mrad", "%", ".1f"),
    Column("backlash_urad", "backlash", "urad", ".0f"),
    Column("friction_urad", "friction", "urad", ".0f"),
    Column("strut_percent", "compensator takes off", "%", ".1f"),
    # an arm that is checked
    Column("part", "link or joint"),
    Column("hangs_percent", "contribution to the sag", "%", ".0f"),
    Column("sag_share_percent", "its share of the sag", "%", ".1f"),
    # Full poses of section 5.2
    Column("check_true.p95_mm", "95 % check, true", "mm", short="95 %\ncheck\ntrue\nmm"),
    Column("check_true.max_relative_percent", "max rel., true", "%", ".2f"),
    # The order m of the vector space, Eq. (16)
    Column("m", "order m", form="d"),
    Column("f_m_over_optimum", "F_M over optimum", form=".5f"),
    # Conservative by constraint, or by a choice among equal fits: seeds
    Column("free", "directions free", form="d"),
    Column("also_conservative", "conservative solution of MLS56's fit", form="d"),
    Column("excess_percent", "F_M above the optimum", "%", ".2f"),
    Column("reaches_optimum", "reaches the optimum", form="yes"),
    # One compliance of section 5.1 beside the true one, and beside the printed one
    *(
        Column(key, heading, unit, form, paper=key, short=short)
        for key, heading, unit, form, short in (
            ("symmetric", "symmetric", "", "yes", "symmetric"),
            ("negative_eigenvalue_matrix", "eigenvalue below 0", "", "yes", "eigenvalue\nbelow 0"),
            ("negative_eigenvalue", "of symmetric part below 0", "", "yes", "of sym.\npart"),
            ("matrix_eigenvalue_micro", "smallest eigenvalue", SI, ".3f", f"smallest\n{SI}"),
            ("symmetric_eigenvalue_micro", "smallest of symmetric part", SI, ".3f", f"of sym.\npart\n{SI}"),
            ("position_rms_um", "position error", "um", ".1f", ""),
            ("position_relative_percent", "of the deflection", "%", ".2f", "%"),
            ("rotation_rms_urad", "rotation error", "urad", ".0f", ""),
            ("rotation_relative_percent", "of the rotation", "%", ".2f", "%"),
            ("force_position_rms_um_per_N", "C force-position", "um/N", ".2f", "force\npos.\num/N"),
            (
                "moment_position_rms_um_per_Nm", "C moment-position", "um/(N m)", ".2f",
                "moment\npos.\num/(N m)",
            ),
            ("force_rotation_rms_urad_per_N", "C force-rotation", "urad/N", ".2f", "force\nrot.\nurad/N"),
            (
                "moment_rotation_rms_urad_per_Nm", "C moment-rotation", "urad/(N m)", ".2f",
                "moment\nrotation\nurad/(N m)",
            ),
        )
    ),
    # Any numbers, a line each
    Column("value", "value", form=".3g"),
    # Statements of the paper
    Column("claim", "statement"),
    # a hung weight: Eq. (6) and (7)
    Column("load_N", "load", "N", ".4g"),
    Column("rms_um", "RMS error", "um", ".2f", rounding=ROUNDING_UM),
    # solvers of Eq. (19)
    Column("key", "solver"),
    Column("relative_excess", "over (d)", form=".1e", rounding=1e-12, short="over\n(d)"),
    Column("relative_excess_bound", "over the bound", form=".1e", short="over\nthe\nbound"),
    Column("solve_seconds", "time", "s", ".3g"),
    Column("seconds_to_1_percent", "time to 1 %", "s", ".3g", short="to\n1 %\ns"),
    Column("ratio_to_conic", "to 1 %, times (d)", form=".3g", short="to 1 %\nx (d)"),
    Column("whole_ratio_to_conic", "whole time, times (d)", form=".3g"),
    Column("evaluations", "F_M evaluations", form=".0f"),
    Column("local_solves_elsewhere", "of them elsewhere", form="d"),
    # readings of a real arm: series A and C
    Column("judged", "judged on"),
    Column("blocks_mm", "blocks", "mm"),
    Column("a_to_c_mm", "A to C", "mm"),
    Column("c_to_a_mm", "C to A", "mm"),
    Column("realigned_mm", "realigned", "mm"),
    Column("evenly_mm", "C and 50 of A to A", "mm"),
    Column("by_plan_mm", "C and 50 planned of A to A", "mm"),
    Column("error.n", "poses that judge", form="d"),
    Column("error.mean_mm", "mean error", "mm"),
    Column("error.rms_mm", "RMS", "mm"),
    Column("error.p95_mm", "95 %", "mm"),
    Column("error.max_mm", "largest", "mm"),
    Column("error.coverage_95", "share inside 95 %"),
    Column("strange_to_A_percent", "poses of C far from A's angles", "%", ".0f"),
    Column("strange_to_C_percent", "poses of A far from C's angles", "%", ".0f"),
    *(Column(f"rms_{by}_urad", f"RMS by {by}", "urad", ".0f") for by in "AC"),
    Column("common_deg", "angles that both visited", "deg", ".0f"),
    Column("correlation", "correlation of A and C there", form=".2f"),
    # plans of poses, beside random ones
    Column("plan", "poses by"),
    Column("ground", "tasks"),
    Column("efficiency_percent", "efficient, at least", "%", ".1f", short="efficient\n>= %"),
    Column("tasks_mm", "error at the tasks", "mm", short="tasks\nmm"),
    Column("workspace_mm", "error over the workspace", "mm", short="workspace\nmm"),
    Column("expected_tasks_mm", "forecast tasks", "mm", short="forecast\ntasks\nmm"),
    Column("promised", "promises"),
    Column("count", "cases", form="d"),
    Column("inside_90", "inside 90 % interval", form="yes"),
    Column("below", "below", form="yes"),
    Column("above", "above", form="yes"),
    Column("inside_95", "deflections inside 95 % interval", form="yes"),
    Column("over_promised", "simulated over promised", form=".2f"),
    Column("planned_mm", "planned", "mm"),
    Column("random_mm", "random", "mm"),
    Column("over_random", "planned over random", form=".2f"),
    Column("planned_better", "planned better", form="d"),
    Column("better_than_joints", "better than joint stiffness only", form="d"),
    # a plan of poses
    Column("expected_deflection_mm", "deflection", "mm", ".2f"),
    Column("expected_sag_mm", "sag", "mm", ".2f"),
    Column("error_there_mm", "error there", "mm"),
    Column("travel_deg", "travel", "deg", ".0f"),
    Column("travel_mm", "travel", "mm", ".0f"),
    Column("greedy_mm", "best next pose", "mm"),
    Column("random_median_mm", "random median", "mm"),
    Column("random_p10_mm", "random 10 %", "mm"),
    Column("random_p90_mm", "random 90 %", "mm"),
    # a corrected program
    Column("label", "point"),
    Column("before_mm", "as programmed, off by", "mm", short="as\nprogrammed\nmm"),
    Column("half_95_mm", "corrected, within (95 %)", "mm", short="corrected\n(95 %)\nmm"),
    Column("turn_left_mrad", "turn that is left", "mrad", short="turn\nleft\nmrad"),
    Column("reason", "left as it is because"),
    Column("median_mm", "median", "mm"),
    Column("p95_mm", "95 %", "mm"),
    Column("max_mm", "largest", "mm"),
    # a prediction
    Column("deflection_mm", "tool moves", "mm", short="moves\nmm"),
    Column("half_words", "+- (95 %)", "mm", short="+- 95 %\nmm"),
    *(Column(f"deflections_mm.{k}", axis, "mm", short=f"{axis}\nmm") for k, axis in enumerate("xyz")),
    Column("turn_mrad", "turns", "mrad", ".2f", short="turns\nmrad"),
    Column("stiffness_n_per_um.0", "least stiffness", "N/um", ".3g", short="softest\nN/um"),
    Column("softest", "where softest", short="direction"),
    # a family of true arms and priors
    Column("prior_error", "prior", called=PRIORS_CALLED),
    Column("where", "which cases"),
    Column("over_joints", "over joint stiffness only", form=".2f"),
    Column("loses", "loses to joint stiffness only", form="yes"),
    Column("chosen", "what the default chose"),
    Column("share", "share of cases", form="yes"),
    Column("covered_percent", "covered", "%", ".1f"),
    Column("half_mm", "half width", "mm"),
    Column("over_ideal", "half width over the ideal", form=".2f"),
    Column("doubted", "any doubt", form="yes"),
    Column("told", "what is wrong is contradicted", form="yes"),
    Column("unchecked", "is named as unchecked", form="yes"),
    Column("otherwise", "where another one is wrong", form="yes"),
    Column("either", "contradicted or unchecked", form="yes"),
    # Models by cases of a factor: noise, instruments, disturbances
    Column("um_per_um", "cost of 1 um of noise", "um", ".2f", short="cost\nof\n1 um\num"),
    Column("distance_m", "distance", "m", "g"),
    Column("payload_kg", "weight", "kg", "g"),
    Column("case", "disturbance", called={"none": "no disturbance"}),
    Column("moved_um", "moves deflections by", "um", ".0f"),
    Column("added_um", "adds to the error", "um", "+.0f"),
    Column("true_change_percent", "error changes, true", "%", "+.1f"),
    Column("true_within", "within the claim, true", form="yes"),
    Column("read_change_percent", "changes, against readings", "%", "+.1f"),
    Column("read_within", "within the claim, against readings", form="yes"),
    Column("kind", "true arms"),
    Column("default_um", "default", "um", ".0f", exact=True),
    Column("Joints_um", "joint stiffness only", "um", ".0f", exact=True),
    Column("same_prior_um", "LS + same prior", "um", ".0f", exact=True),
    Column("worst_tenth_percent", "in the worst tenth", "%", ".1f"),
    Column("beats_joints", "beats joint stiffness only", form="yes"),
    Column("beats_same_prior", "beats LS + same prior", form="yes"),
    # absolute readings: what hides in what, and what lies in its interval
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
    # what runs tell, and what would help
    Column("place", "", form="d"),
    Column("measure", "measured besides"),
    Column("expected_error_mm", "expected error", "mm", short="expected\nerror mm"),
    # jobs of a corrected robot
    Column("removed_percent", "removed", "%", ".1f"),
    Column("worst_percent", "worst case", "%", ".1f"),
    Column("nine_percent", "cases with 90 % or more removed", "%", ".1f"),
    Column("worse", "cases made worse", form="d"),
    Column("before.median_mm", "before", "mm"),
    Column("after.median_mm", "after", "mm"),
    Column("after.p95_mm", "after, 95th percentile", "mm"),
    Column("after.most_mm", "after, largest", "mm"),
    Column("unseen_percent", "without bound", "%", ".1f"),
    Column("buckled", "trials without equilibrium", form="d"),
    # an arm that is calibrated
    Column("tried", "errors", short="errors\ntried"),
    Column("after_mm", "held-out blocks, RMS", "mm", short="held out\nblocks\nmm"),
    Column("series_after_mm", "held-out series, RMS", "mm", short="held out\nseries\nmm"),
    Column("after.n", "positions", form="d"),
    Column("before.mean_mm", "as drawn, mean", "mm"),
    Column("after.mean_mm", "calibrated, mean", "mm"),
    Column("after.max_mm", "calibrated, largest", "mm"),
    Column("half_95", "+- (95 %)", form=".2g"),
    Column("folder", "in the folder", form=".3g"),
    Column("rms_urad", "RMS over a turn", "urad", ".0f"),
    Column("largest.order", "largest order", form="d"),
    Column("largest.amplitude_urad", "its amplitude", "urad", ".0f"),
    Column("largest.deviation_urad", "+- (1 sd)", "urad", ".0f"),
    Column("significant", "orders above 3 sd", form="d"),
    # entries of the bench
    Column("standing", "rank"),
    Column("over_default", "error over the incumbent's"),
    Column("over", "error over the incumbent's", form=".2f"),
    Column("with_prior", "with prior"),
    Column("without_prior", "without prior"),
    Column("tied", "tied with it", form="yes"),
    Column("given", "class"),
    Column("version", "version", form="d"),
    Column("cpu_seconds", "processor time", "s", ".2g"),
    Column("rms_mm", "RMS error", "mm"),
    Column("marker", "target"),
    Column("pull", "counts", form=".2f"),
)  # fmt: skip
"""Of rows and of report.json; a study adds its own here."""
NONE = {
    "times_less": "itself",
    "uncertainty_percent": "no prior",
    "half_95_mm": "no bound",
    "intervals.half_width_mm": "no bound",
    "elsewhere.half_width_mm": "no bound",
    "elsewhere.apart_mm": "not compared",
    "folder": "not in it",
    "ratio": "no ratio",
    "f_m_held_out": "not held out",
    "check.rms_mm": "none held out",
    "series_after_mm": "one series",
    "gears_kept_percent": "no choice",
    "links_kept_percent": "no choice",
    **dict.fromkeys(("covered_percent", "half_mm", "over_ideal"), "no interval"),
    "failed": "never",
    "tied": "itself",
    "with_prior": "none",
    "without_prior": "none",
    "unseen_percent": "no interval",
    "efficiency_percent": "no plan",
    "expected_tasks_mm": "no plan",
    "evaluations": "none",
    "local_solves": "none",
    "local_solves_elsewhere": "none",
    "draws": "all poses",
    "correlation": "no error",
    "told": "none is wrong",
    "unchecked": "none is wrong",
    "otherwise": "none is wrong",
    "either": "none is wrong",
    "place": "-",
}
"""Why a cell has no number, where that is not that the model was not fitted."""
EVERY = tuple(replace(column, none=NONE.get(column.key, column.none)) for column in DECLARED)
KNOWN = {column.key: column for column in EVERY}


def columns(keys: str, *, paper: bool = True) -> tuple[Column, ...]:
    """Columns by their keys, blanks between; with the paper's numbers where they have such."""
    found = tuple(KNOWN[key] for key in keys.split())
    return found if paper else tuple(replace(column, paper="") for column in found)
