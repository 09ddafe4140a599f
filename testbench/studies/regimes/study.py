"""Where the cone pays by itself: GCO beside least squares of the same structure, and what the cone adds."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import CALLED
from testbench.report.campaigns import pairs
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.factorial import compare
from testbench.studies.factorial.trial import writes
from testbench.studies.regimes import trial
from testbench.studies.regimes.trial import (
    EQUAL,
    FEATURED_POSES,
    FEATURED_SIGMA,
    GCO,
    JOINTS,
    LENT,
    NONE,
    PRIORS,
    SQUARES,
    Options,
    Settings,
)
from testbench.studies.study import Study
from testbench.trials.spread import Number, ends, middle, most_trials, span
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, capital, counted
from testbench.views.ratio_figure import maps
from testbench.views.schema import Table, pivot

KINDS = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LEVELS = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
NAMES = ("0 to 1 %", "1 to 3 %", "3 to 10 %", "10 to 30 %", "30 to 100 %", "over 100 %")
FREE = "the cone does not bind"
MATTERS = 0.95  #: Ratio of errors, median, above which a gain is too small to count.
CELL = ("part", "structure", "poses", "sigma_um")
PAIRS = [(GCO, theirs) for theirs in (SQUARES, LENT, EQUAL, JOINTS)]
HOW = Markdown(
    "## How to read the maps\n\n"
    "GCO and least squares of one structure differ in what they take for the directions that no reading "
    "sees, and in what the cone does to those that the data see. Same free directions: least squares with "
    "those of GCO; what is then left is the cone's own work. PSD of equal fit: least squares that is "
    "conservative where that can be. The cone binds where it cannot. Error to expect: what noise alone "
    "leaves least squares over the workspace, from rows and sigma. Least squares weighs positions and "
    "rotations as GCO ends up weighing them. Poses are nested and share their noise.\n\n"
    "Noise moves the fit of least squares in all directions that the data see. GCO keeps the part of it that "
    "a conservative model can have. Where a direction's compliance is far larger than its noise, that is all "
    "of it. Where it is smaller, half of the noise would make an eigenvalue negative, and is cut off."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by cell, level and prior."""
    plain = trials.where(uncertainty=NONE)
    cells = compare.duels(plain, PAIRS, *CELL, within=("true_arm",))
    errors = compare.cells(plain, *CELL, also=("free",))
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth=asked.truths,
        arms={kind: grid.arm for kind, grid in asked.grids.items()},
        trials=len(seeds),
        workspace_poses=asked.judged,
        cells=cells,
        errors=errors,
        counts={kind: _counts(kind, cells, errors) for kind in KINDS},
        levels=_levels(plain),
        priors=compare.duels(
            trials.where(uncertainty=set(PRIORS)),
            [(GCO, SQUARES), (GCO, JOINTS)],
            *("part", "uncertainty"),
            within=("true_arm", *CELL[1:]),
        ),
        worst={kind: max(_of(cells, kind, SQUARES), key=lambda row: middle(row.ratio)) for kind in KINDS},
        featured_poses=FEATURED_POSES,
        featured_um=UM * FEATURED_SIGMA,
        dataset=compare.dataset(trials),
    )
    at = {"part": "gravity", "poses": FEATURED_POSES, "sigma_um": f.featured_um}
    here = [row for row in errors if all(row[key] == value for key, value in at.items())]
    f["structure"] = min((m for m in here if m.name == GCO), key=lambda m: middle(m.rms_um)).structure
    own = compare.by_case(plain.where(structure=f.structure, **at), "true_arm")
    rivals = {"least_squares": (GCO, SQUARES), "joints": (GCO, JOINTS)}
    f["gains"] = pairs(own, rivals, compare.ERROR, 1e-3)
    f["models"] = [model for row in here for model in compare.contract([row], where=row.structure)]
    where = say("A weight, {featured_poses} poses, {featured_um:g} um of noise, {structure}:", f)
    worst = "{structure}, {poses} poses, {sigma_um:g} um: GCO errs {ratio:~.2f} times"
    return Report(
        scenario=STUDY.name,
        question=Markdown("Where does the cone pay by itself?"),
        title=_title(f),
        answer=lines([where, *compare.beside_rivals(f.gains, "fit")]),
        worst=lines(
            [
                say(f"Worst under a weight: {worst} least squares.", f.worst["gravity"]),
                say(f"Under six wrenches: {worst}.", f.worst["full_pose"]),
            ]
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW],
    )


def _of(cells: Sequence[Row], kind: str, theirs: str) -> list[Row]:
    """Cells of one kind of reading, beside one method."""
    return [row for row in cells if (row.part, row.theirs) == (kind, theirs)]


def pays(ratio: Number) -> bool:
    """Whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the middle."""
    return ends(ratio)[1] < 1 and middle(ratio) <= MATTERS


def costs(ratio: Number) -> bool:
    """Whether it is above 1 in as many, in the middle by as much."""
    return ends(ratio)[0] > 1 and middle(ratio) >= 1 / MATTERS


def _counts(kind: str, cells: Sequence[Row], errors: Sequence[Row]) -> Row:
    """How many cells do what; the cone by itself pays with the same free directions."""
    lent, squares, joints = (_of(cells, kind, theirs) for theirs in (LENT, SQUARES, JOINTS))
    free = [middle(row.free) > 0 for row in errors if (row.part, row.name) == (kind, GCO)]
    beats = [row.won > 0.5 for row in joints]
    cone, own = ([pays(row.ratio) for row in rows] for rows in (lent, squares))
    cost = [costs(row.ratio) for row in squares]
    return Row(
        cells=len(lent),
        cone_pays=sum(cone),
        cone_pays_and_beats_joints=sum(map(all, zip(cone, beats, strict=True))),
        pay=sum(own),
        pay_and_beat_joints=sum(map(all, zip(own, beats, strict=True))),
        cost=sum(cost),
        cost_with_free=sum(map(all, zip(cost, free, strict=True))),
    )


def _levels(plain: Trials) -> list[Row]:
    """By the error that noise is expected to leave where the cone binds, ascending; and where it does not."""
    level = np.where(plain["binds"], np.digitize(plain["expected"], LEVELS), len(NAMES))
    duels = compare.duels(plain.add(level=level), PAIRS, "part", "level", within=("true_arm", *CELL[1:]))
    fits = {
        (kind, theirs): sum(d.trials for d in _of(duels, kind, theirs))
        for kind in KINDS
        for _, theirs in PAIRS
    }
    names = dict(enumerate((*NAMES, FREE)))
    return [
        Row(row, level=names[row.level], fits_share=row.trials / fits[row.part, row.theirs])
        for row in sorted(duels, key=lambda row: int(row.level))
    ]


def _tables(f: Row) -> dict[str, Table]:
    """A map of every kind of reading, and both by the error to expect."""
    cell, sigma, level, theirs, share, ratio = columns("cell sigma_um level theirs fits_share ratio")
    found = {}
    for kind, words in KINDS.items():
        rows = [Row(row, cell=f"{row.structure}, {row.poses} poses") for row in _of(f.cells, kind, SQUARES)]
        found[kind] = pivot(Table((), rows, f"{words}: GCO over least squares, by noise"), cell, sigma, ratio)
    rows = [
        Row(row, level=f"{KINDS[kind]}: {row.level}")
        for kind in KINDS
        for row in f.levels
        if row.part == kind
    ]
    title = "GCO's error over the other's, by the error to expect of least squares over the deflection"
    return found | {"levels": pivot(Table((), rows, title), level, theirs, ratio, share)}


def _title(f: Row) -> Markdown:
    """What was compared."""
    return say(
        "GCO beside least squares of the same structure on the same readings, without prior: RMS errors over "
        "the workspace, {trials}, true arms: {arms:list}. GCO pays in a cell where it wins in {most} and "
        "lowers the median error by 5 %. Ratios are medians ({ends}).",
        trials=counted(f.trials, "trial"),
        arms=[CALLED[name] for name in f.truth],
        most=most_trials(f.gains.joints.trials).replace("trial", "fit"),
        ends=span(f.gains.joints.trials),
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    for kind, words in KINDS.items():
        own = f.counts[kind]
        never = own.cone_pays and not own.cone_pays_and_beats_joints
        also = "in {cone_pays_and_beats_joints} of these GCO beats joint stiffness only"
        also = "in all of these joint stiffness only is better" if never else also
        yield say(
            f"{capital(words)}: the cone by itself pays in {{cone_pays}} of {{cells}} cells; {also}.", own
        )
    if levels := [row for row in _of(f.levels, "gravity", LENT) if row.level != FREE]:
        yield say(
            "It gains most where noise swamps least squares: {ratio:~.2f} times their error where noise "
            "costs {level} of the deflection, {low:~.2f} at {least}.",
            levels[-1],
            low=levels[0].ratio,
            least=levels[0].level,
        )


def figures(found: Report) -> dict[str, Figure]:
    """Maps of noise by poses, a structure and ratio each."""
    f, panes = Row(found.numbers), {}
    for kind, words in KINDS.items():
        beats = [row.won for row in _of(f.cells, kind, JOINTS)]
        for theirs, called in ((SQUARES, f"GCO over {SQUARES}"), (LENT, LENT)):
            rows = [Row(r, beats_joints_in=b) for r, b in zip(_of(f.cells, kind, theirs), beats, strict=True)]
            for structure in dict.fromkeys(row.structure for row in rows):
                own = [row for row in rows if row.structure == structure]
                title = f"{words.partition(',')[0]}, {structure}: {called}"
                panes[title] = Table(columns("sigma_um poses ratio"), own)
    where = f"A weight, {f.featured_poses} poses, {f.featured_um:g} um of noise, {f.structure}:"
    reading = (
        f"GCO's RMS error over the workspace over the other's, medians of {f.trials} trials, "
        f"{len(f.truth)} true arms in turn; below 1 GCO is better. Hatched: their "
        f"{span(f.gains.joints.trials)} holds 1. Framed: GCO beats joint stiffness only in most trials."
    )
    answer = f"{where} {compare.gains_told(f.gains)}"
    return {"regimes.png": maps(panes, answer, reading, KNOWN["beats_joints_in"])}


STUDY = Study(
    name="regimes",
    about="Map where GCO beats least squares of the same structure: noise, poses, structure, truth, prior.",
    options=Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(grid.arm) for grid in asked.grids.values()],
    row=trial.MethodRow,
    trials=trial.trials,
    report=report,
    printed=tuple(KINDS),
    figures=figures,
    write=writes(trial.first_runs),
)
