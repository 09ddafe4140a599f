"""The columns of the study of absolute calibration, and its tables."""

from dataclasses import replace

from testbench.studies.absolute_calibration.report import AbsoluteCalibrationReport
from testbench.views.schema import Column, Table, pivot


def _percent(key: str, heading: str) -> Column:
    return Column(key, heading, "%", ".1f", scale=100)


MODEL, NAME, ARM = Column("model", "model"), Column("name", "model"), Column("arm", "arm")
POSES = Column("poses", "poses", form="d")
ERROR = Column("error_mm", "error, own weight", "mm")
LOADED = Column("loaded_mm", "error, payload", "mm")
OVER = Column("over_optimum", "over the optimum", "", ".2f")
POSITIONS = _percent("inside.positions", "positions inside")
PARTS = (
    _percent("inside.geometry", "geometry inside"),
    _percent("inside.joint_errors", "joint errors inside"),
    _percent("inside.joints", "joint compliances inside"),
    _percent("inside.entries", "entries of C inside"),
)
OFF = (_percent("off_2", "c2 off, RMS"), _percent("off_3", "c3 off, RMS"))
MODELS = (NAME, ARM, POSES, Column("trials", "trials", form="d"), ERROR, OVER, POSITIONS, *PARTS)
HIDING = (
    MODEL,
    ARM,
    Column("true_arm", "true arm"),
    ERROR,
    _percent("bias_2", "c2 off, median"),
    OFF[0],
    _percent("bias_3", "c3 off, median"),
    OFF[1],
    Column("geometry_off", "geometry off", "mm, mrad"),
    POSITIONS,
    *PARTS[:3],
    _percent("gears_kept", "joint errors kept"),
    _percent("links_kept", "links kept"),
)
CAMPAIGNS = (
    Column("campaign", "campaign"),
    ARM,
    POSES,
    Column("readings", "readings", form="d"),
    MODEL,
    ERROR,
    LOADED,
    *OFF,
)


def tables(report: AbsoluteCalibrationReport) -> dict[str, Table]:
    """Errors by number of poses and arm, intervals, what hides, campaigns."""
    by_poses = {
        f"poses, {arm}": pivot(
            Table(
                MODELS, [row for row in report.models if row.arm == arm], f"{arm}: RMS error, own weight, mm"
            ),
            NAME,
            replace(POSES, unit="poses"),
            ERROR,
        )
        for arm in report.arms
    }
    featured = Table(
        (),
        [row for row in report.models if row.poses == report.featured],
        f"RMS error where nothing was measured, {report.featured} poses, own weight, mm",
    )
    return {
        "short": pivot(featured, NAME, ARM, ERROR),
        "recorded": pivot(featured, NAME, ARM, replace(ERROR, exact=True)),
        **by_poses,
        "models": Table(MODELS, report.models),
        "hiding": Table(HIDING, report.hiding),
        "campaigns": Table(CAMPAIGNS, report.campaigns),
    }
