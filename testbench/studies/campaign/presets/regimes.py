"""Preset `regimes`: where the cone pays by itself, GCO beside least squares of the same structure."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.report.colours import look
from testbench.report.figure import Figure, ranges
from testbench.report.report import Report
from testbench.report.schema import Table, columns
from testbench.report.table import SHARED, TRIAL, Row, Trials, matched, number
from testbench.runs.spread import SAME_ERROR, Number, ends, middle
from testbench.studies.campaign import grids
from testbench.studies.campaign.grids import GCO, JOINTS, LENT, SQUARES, GridSettings
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, by_case
from testbench.workflows.rows import UM

KINDS = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LEVELS = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
NAMES = ("0 to 1 %", "1 to 3 %", "3 to 10 %", "10 to 30 %", "30 to 100 %", "over 100 %")
FREE = "the cone does not bind"
MATTERS = 0.95  #: Ratio of errors, median, above which a gain is too small to count.
CELL = ("part", "structure", "poses", "sigma_um")
LOOKS = {SQUARES: look("MLS56", "none"), LENT: look("MLS56", "free"), JOINTS: look("Joints", "none")}
"""Of those that GCO is drawn beside."""
PAYS = "way cells cone_pays beats_too"
BY_LEVEL = TrialTable("", down="level", across="theirs", value="ratio", columns="fits_share", by="part")


def tables(_: GridSettings) -> Mapping[str, TrialTable]:
    """Map every kind of reading; tabulate both by the error to expect; count cells in which the cone pays."""
    maps = {
        part: TrialTable(
            f"{words}: GCO over least squares, by noise",
            down="cell",
            across="sigma_um",
            value="ratio",
            where={"part": part, "name": SQUARES},
        )
        for part, words in KINDS.items()
    }
    levels = replace(
        BY_LEVEL,
        title="GCO's error over the other's, by the error to expect of least squares over the deflection",
        where={"pair": True},
        rows=lambda trials: BY_LEVEL.cells(trials.pick(np.argsort(trials["order"], kind="stable"))),
    )
    count = TrialTable("Cells in which the cone pays by itself", columns=PAYS, rows=paying)
    return maps | {"levels": levels, "pays": count}


def _derived(_: GridSettings, own: Trials) -> Trials:
    """Add GCO's error over theirs in the same fit, and the error to expect."""
    kind = np.array([list(KINDS).index(part) for part in own["part"]])
    level = np.where(own["binds"], np.digitize(own["expected"], LEVELS), len(NAMES))
    code, gco = 10 * kind + level, own["name"] == GCO
    share = {k: np.sum(gco & (code == k)) / np.sum(gco & (kind == k // 10)) for k in np.unique(code)}
    names = (*NAMES, FREE)
    own = own.add(
        ratio=matched(own, own.where(name=GCO), ERROR, (*CELL, "true_arm", TRIAL)) / own[ERROR],
        theirs=own["name"],
        pair=~gco,
        order=code,
        fits_share=np.array([share[k] for k in code]),
        level=[f"{KINDS[part]}: {names[k]}" for part, k in zip(own["part"], level, strict=True)],
        cell=[f"{s}, {n} poses" for s, n in zip(own["structure"], own["poses"].astype(int), strict=True)],
    )
    return by_case(own, "true_arm")


def paying(own: Trials) -> Iterator[Row]:
    """Count cells in which the cone pays by itself, with the same free directions, and beats joints too."""
    for (part,), kind in own.groups("part"):
        cone, beats = [], []
        for _, cell in kind.groups(*CELL):
            lent, joints = (cell.where(name=theirs) for theirs in (LENT, JOINTS))
            cone.append(pays(number(lent["ratio"], lent[SHARED])))
            beats.append(cone[-1] and np.mean(joints["ratio"] < 1 - SAME_ERROR) > 0.5)
        yield Row(way=KINDS[part], cells=len(cone), cone_pays=sum(cone), beats_too=int(sum(beats)))


def pays(ratio: Number) -> bool:
    """Tell whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the median."""
    return ends(ratio)[1] < 1 and middle(ratio) <= MATTERS


def _cells(_: GridSettings, trials: Trials) -> Mapping[str, Where]:
    """Choose the cell of section 6 by structure, that in which GCO errs least first."""
    poses, sigma = grids.FEATURED
    at = {"part": "gravity", "poses": poses, "sigma_um": UM * sigma}
    here = trials.where(name=GCO, **at)
    errors = {name: np.median(own[ERROR]) for (name,), own in here.groups("structure")}
    return {name: {**at, "structure": name} for name in sorted(errors, key=lambda name: errors[name])}


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw GCO over others by the error that noise is expected to leave, a pane a kind of reading."""
    rows = [row for row in Row(found.numbers).cells["levels"] if row.theirs != grids.EQUAL]
    others = [name for name in dict.fromkeys(row.theirs for row in rows) if name not in LOOKS]
    looks = LOOKS | {name: look(f"own {k}", "own") for k, name in enumerate(others, 1)}
    shown = columns("level theirs ratio")
    looks = {shown[1].text(name): own for name, own in looks.items()}
    places = [name for name in (*NAMES, FREE) if any(row.level.endswith(f": {name}") for row in rows)]
    panes = {
        words: Table(
            shown,
            [Row(row, level=row.level.partition(": ")[2]) for row in rows if row.part == part],
            looks=looks,
        )
        for part, words in KINDS.items()
    }
    reading = (
        "GCO's RMS error over the other's: medians and their spread. Left of the dotted line GCO is better."
    )
    return {"regimes.png": ranges(panes, found.question, reading, 1.0, places)}


PRESET = Preset(
    name="regimes",
    page="docs/studies/regimes.md",
    question="Where does the cone help by itself?",
    how="GCO and least squares of the same structure fit the same readings, without a prior. They are judged "
    "over the workspace. Every trial has true arms of two kinds.",
    options=grids.GridOptions,
    settings=grids.settings,
    seeds=(100, 2),
    row=grids.GridMethodRow,
    trial=grids.trial,
    shared=grids.cells,
    tables=tables,
    printed="gravity",
    cells=_cells,
    ours=GCO,
    rivals=(SQUARES,),  # the cone by itself: the same structure
    pairs=((GCO, LENT), (GCO, grids.EQUAL), (GCO, JOINTS)),
    derived=_derived,
    figures=figures,
    arms=lambda settings: [find_arm(grid.arm) for grid in settings.grids.values()],
)
STUDY = PRESET.study()
