"""Where the cone pays by itself: GCO beside least squares of the same structure, and what the cone adds."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.rows import UM
from testbench.campaign.true_arms import CALLED
from testbench.report.badge import of_rivals
from testbench.report.campaigns import pairs
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.factorial import compare
from testbench.studies.regimes import trial
from testbench.studies.regimes.trial import (
    EQUAL,
    FEATURED,
    GCO,
    JOINTS,
    LENT,
    NONE,
    SQUARES,
    Options,
    Settings,
)
from testbench.studies.study import Study
from testbench.trials.spread import Number, ends, middle, most_trials, span
from testbench.views.colours import look
from testbench.views.figure import Figure, ranges
from testbench.views.markdown import Markdown, capital, counted
from testbench.views.schema import Table, pivot

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
RIVALS = (SQUARES, LENT, EQUAL, JOINTS)
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
    """Medians and spreads by cell and by the error to expect."""
    plain = trials.where(uncertainty=NONE)
    cells = compare.duels(plain, _pairs(plain), *CELL, within=("true_arm",))
    errors = compare.cells(plain, *CELL, also=("free",))
    at = {"part": "gravity", "poses": FEATURED[0], "sigma_um": UM * FEATURED[1]}
    here = [row for row in errors if all(row[key] == value for key, value in at.items())]
    best = min((m for m in here if m.name == GCO), key=lambda m: middle(m.rms_um)).structure
    own = compare.by_case(plain.where(structure=best, **at), "true_arm")
    f = Row(
        compare.head(seeds, trials),
        truth=asked.truths,
        arms={kind: grid.arm for kind, grid in asked.grids.items()},
        workspace_poses=asked.judged,
        cells=cells,
        errors=errors,
        counts={kind: _counts(kind, cells) for kind in KINDS},
        levels=_levels(plain),
        worst={kind: max(_of(cells, kind, SQUARES), key=lambda row: middle(row.ratio)) for kind in KINDS},
        structure=best,
        fits=len(own.where(name=GCO)),
        gains=pairs(own, {"least_squares": (GCO, SQUARES), "joints": (GCO, JOINTS)}, compare.ERROR, 1e-3),
        models=[model for row in here for model in compare.contract([row], where=row.structure)],
    )
    where = say("A weight, {poses} poses, {sigma_um:g} um of noise, {structure}:", at, structure=best)
    each = say("case of {structure}, {poses} poses, {sigma_um:g} um", at, structure=best)
    worst = "{structure}, {poses} poses, {sigma_um:g} um: GCO errs {ratio:~.2f} times"
    return Report(
        scenario=STUDY.name,
        question=Markdown("Where does the cone pay by itself?"),
        title=_title(f),
        answer=lines(_paid(f)),
        worst=lines(
            [
                say(f"Worst cell under a weight, medians: {worst} least squares.", f.worst["gravity"]),
                say(f"Under six wrenches: {worst}.", f.worst["full_pose"]),
            ]
        ),
        claims=[lines([where, *compare.beside_rivals(f.gains)]), _gained(f)],
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW],
        badge=of_rivals(own, GCO, [SQUARES], compare.ERROR, each),  # the cone by itself: the same structure
    )


def _pairs(plain: Trials) -> list[tuple[str, str]]:
    """GCO beside all others, estimators of one's own among them."""
    own = [name for name in plain.values("name") if name not in (GCO, *RIVALS)]
    return [(GCO, theirs) for theirs in (*RIVALS, *own)]


def _of(cells: Sequence[Row], kind: str, theirs: str) -> list[Row]:
    """Cells of one kind of reading, beside one method."""
    return [row for row in cells if (row.part, row.theirs) == (kind, theirs)]


def pays(ratio: Number) -> bool:
    """Whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the middle."""
    return ends(ratio)[1] < 1 and middle(ratio) <= MATTERS


def _counts(kind: str, cells: Sequence[Row]) -> Row:
    """In how many cells the cone by itself pays: with the same free directions."""
    lent, joints = (_of(cells, kind, theirs) for theirs in (LENT, JOINTS))
    cone = [pays(row.ratio) for row in lent]
    beats = [paid and row.won > 0.5 for paid, row in zip(cone, joints, strict=True)]
    return Row(cells=len(lent), cone_pays=sum(cone), cone_pays_and_beats_joints=sum(beats))


def _levels(plain: Trials) -> list[Row]:
    """By the error that noise is expected to leave where the cone binds, ascending; and where it does not."""
    names = (*NAMES, FREE)
    level = np.where(plain["binds"], np.digitize(plain["expected"], LEVELS), len(NAMES))
    duels = compare.duels(
        plain.add(level=level), _pairs(plain), "part", "level", within=("true_arm", *CELL[1:])
    )
    fits = {kind: sum(row.trials for row in _of(duels, kind, SQUARES)) for kind in KINDS}
    return [
        Row(row, level=names[int(row.level)], fits_share=row.trials / fits[row.part])
        for row in sorted(duels, key=lambda row: int(row.level))
    ]


def _tables(f: Row) -> dict[str, Table]:
    """A map of every kind of reading, and both by the error to expect."""
    cell, sigma, level, theirs, share, ratio = columns("cell sigma_um level theirs fits_share ratio")
    found, told = {}, []
    for kind, words in KINDS.items():
        rows = [Row(row, cell=f"{row.structure}, {row.poses} poses") for row in _of(f.cells, kind, SQUARES)]
        found[kind] = pivot(Table((), rows, f"{words}: GCO over least squares, by noise"), cell, sigma, ratio)
        told += [Row(row, level=f"{words}: {row.level}") for row in f.levels if row.part == kind]
    title = "GCO's error over the other's, by the error to expect of least squares over the deflection"
    return found | {"levels": pivot(Table((), told, title), level, theirs, ratio, share)}


def _title(f: Row) -> Markdown:
    """What was compared."""
    return say(
        "GCO beside least squares of the same structure on the same readings, without prior: RMS errors over "
        "the workspace, {trials}, true arms: {arms:list}. GCO pays in a cell where it wins in {most} and "
        "lowers the median error by 5 %. Ratios are medians ({ends}).",
        trials=counted(f.trials, "trial"),
        arms=[CALLED[name] for name in f.truth],
        most=most_trials(f.trials).replace(str(f.trials), str(f.fits)).replace("trial", "fit"),
        ends=span(f.trials),
    )


def _paid(f: Row) -> Iterator[Markdown]:
    """In how many cells the cone by itself pays, a sentence a kind of reading."""
    for kind, words in KINDS.items():
        own = f.counts[kind]
        never = own.cone_pays and not own.cone_pays_and_beats_joints
        also = "in {cone_pays_and_beats_joints} of these GCO beats joint stiffness only"
        also = "in all of these joint stiffness only is better" if never else also
        yield say(
            f"{capital(words)}: the cone by itself pays in {{cone_pays}} of {{cells}} cells; {also}.", own
        )


def _gained(f: Row) -> Markdown:
    """What the cone by itself gains at most and at least noise."""
    levels = [row for row in _of(f.levels, "gravity", LENT) if row.level != FREE]
    if not levels:
        return Markdown("The cone binds nowhere.")
    return say(
        "The cone gains where noise swamps least squares: {ratio:~.2f} times their error where noise "
        "costs {level} of the deflection, {low:~.2f} at {least}.",
        levels[-1],
        low=levels[0].ratio,
        least=levels[0].level,
    )


def figures(found: Report) -> dict[str, Figure]:
    """GCO over others by the error that noise is expected to leave, a pane a kind of reading."""
    f, shown = Row(found.numbers), columns("level theirs ratio")
    drawn = [r for r in f.levels if r.theirs != EQUAL]
    others = [name for name in dict.fromkeys(r.theirs for r in drawn) if name not in LOOKS]
    looks = LOOKS | {name: look(f"own {k}", "own") for k, name in enumerate(others, 1)}
    looks = {shown[1].text(theirs): own for theirs, own in looks.items()}
    panes = {
        words: Table(shown, [r for r in drawn if r.part == kind], looks=looks)
        for kind, words in KINDS.items()
    }
    reading = (
        "GCO's RMS error over the other's, by what noise is expected to cost least squares, over the "
        f"deflection: medians of fits with {span(f.trials)}, {f.trials} trials. Left of the dotted line "
        "GCO is better. Same free directions: what the cone does by itself."
    )
    places = list(dict.fromkeys(row.level for row in f.levels))  # not every pane has all of them
    return {"regimes.png": ranges(panes, _gained(f), reading, 1.0, places)}


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
    models="name",
)
