"""The columns of the study of regimes, and its tables."""

from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.studies.regimes.campaigns import Kind
from testbench.studies.regimes.report import RegimesReport
from testbench.views.schema import Column, Table, pivot

KINDS: dict[Kind, str] = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LINE = Column("name", "structure and poses")
NOISE = Column("noise_um", "noise of a reading", "um", "g")
OVER_LS = Column("gco_over_ls", "GCO over least squares", form=".2f")
OVER_EQUAL = Column("gco_over_equal", "GCO over PSD of equal fit", form=".2f")
OVER_LENT = Column("gco_over_lent", "GCO over least squares, same free directions", form=".2f")
OVER_JOINTS = Column("gco_over_joints", "GCO over joints alone", form=".2f")
FITTED = Column("fitted", "GCO over least squares in the fitted runs", form=".2f")
BETTER = Column("better_in", "GCO better", form="yes")
BEATS = Column("beats_joints_in", "beats joints", form="yes")
BINDS = Column("binds_in", "cone binds", form="yes")
SHARE = Column("share", "of the fits", form="yes")
LEVELS = (Column("name", "expected error"), SHARE, OVER_LS, OVER_LENT, BETTER, OVER_JOINTS, BEATS)
TRUTHS = (Column("name", "true arm", called=CALLED), *LEVELS[1:])
PRIORS = (
    Column("prior", "uncertainty"),
    NOISE,
    BINDS,
    OVER_LS,
    replace(OVER_LS, key="where_it_binds", heading="where it binds"),
    OVER_JOINTS,
    BEATS,
)
MAPS = {
    "over_ls": OVER_LS,
    "over_equal": OVER_EQUAL,
    "over_lent": OVER_LENT,
    "over_joints": OVER_JOINTS,
    "fitted": FITTED,
    "better": BETTER,
    "binds": BINDS,
}
"""Of every kind of reading: a line a structure and number of poses, a column a noise."""


def tables(report: RegimesReport) -> dict[str, Table]:
    """Maps, levels, truths and priors of every kind of reading."""
    found = {}
    for kind, words in KINDS.items():
        cells = Table((), report.cells[kind], f"{words}: GCO over least squares, median, by noise")
        for name, column in MAPS.items():
            found[f"{kind}_{name}"] = pivot(cells, LINE, NOISE, column)
        found[f"{kind}_short"] = pivot(cells, LINE, NOISE, replace(OVER_LS, exact=True))
        levels = [level for level in (*report.levels[kind], report.free[kind]) if level]
        found[f"{kind}_levels"] = Table(LEVELS, levels, f"{words}: by expected error")
        found[f"{kind}_truths"] = Table(TRUTHS, report.truths[kind], f"{words}: by true arm")
        found[f"{kind}_priors"] = Table(PRIORS, report.priors_by_noise[kind], f"{words}: by prior")
    return found
