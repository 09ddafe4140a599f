"""Where the cone pays by itself: GCO beside least squares of the same structure, and what the cone adds."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.rows import MM, UM
from testbench.bench.truths import CALLED
from testbench.data.csvfile import write_csv
from testbench.identify import Constraint
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged, number
from testbench.studies.factorial import compare
from testbench.studies.regimes import trial
from testbench.studies.regimes.trial import FEATURED_POSES, FEATURED_SIGMA, NONE, PRIORS, Options, Settings
from testbench.studies.study import Run, Study
from testbench.trials.gain import gained
from testbench.trials.spread import SAME, Number, Spread, ends, middle, most_trials, span
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, capital, counted
from testbench.views.ratio_figure import maps
from testbench.views.schema import Table, pivot

KINDS = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LEVELS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, np.inf)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
FREE = "the cone does not bind"
MATTERS = 0.95  #: Ratio of errors, median, above which a gain is too small to count.
RATIOS = {
    "gco_over_ls": ("gco_um", "ls_um"),
    "gco_over_lent": ("gco_um", "lent_um"),
    "gco_over_joints": ("gco_um", "joints_um"),
    "gco_over_equal": ("gco_um", "equal_um"),
    "lent_over_ls": ("lent_um", "ls_um"),
    "fitted": ("gco_fitted_um", "ls_fitted_um"),
}
"""Errors of each fit over those of another."""
SHARES = {"binds_in": "binds", "conservative_in": "conservative", "solved_in": "solved"}
GROUP = "fits_share gco_over_ls gco_over_lent better_in gco_over_joints beats_joints_in"
CELL = (*RATIOS, *SHARES, "better_in", "beats_joints_in", "ls_um", "equal_um", "gco_um", "joints_um")
CELL += ("expected", "free")
DRAWN = {"GCO over least squares": "gco_over_ls", "same free directions": "gco_over_lent"}
HOW = Markdown(
    "## How to read the maps\n\n"
    "GCO and least squares of one structure differ in what they take for the directions that no reading "
    "sees, and in what the cone does to those that the data see.\n\n"
    "- Same free directions: least squares with the free directions of GCO. What is then left is the cone's "
    "own work.\n"
    "- PSD of equal fit: least squares whose free directions make it conservative, nearest to minimum norm; "
    "plain least squares where that cannot be.\n"
    "- The cone binds where no conservative model fits as well as least squares.\n"
    "- Error to expect: what noise alone leaves least squares over the workspace, from rows and sigma, "
    "before any reading is seen; over the deflection that GCO predicts. Lines with percentages: where the "
    "cone binds.\n\n"
    "Least squares weighs positions and rotations as GCO ends up weighing them, so that weights make no "
    "difference. Poses are nested and share their noise.\n\n"
    "Why: noise moves the fit of least squares in all directions that the data see. GCO keeps the part of it "
    "that a conservative model can have. Where a direction's compliance is far larger than its noise, that "
    "is all of it; where it is smaller, half of the noise would make an eigenvalue negative, and is cut off. "
    "Where directions are free, large compliances in these can make every fit conservative, and nothing is "
    "cut off."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by cell, level and prior."""
    rows = _compared(trials)
    kinds = {kind: _of_kind(rows.where(kind=kind)) for kind in KINDS}
    known = trials.keep("measured.").pick(np.isfinite(trials["measured.runs"]))
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth=asked.truths,
        arms={kind: grid.arm for kind, grid in asked.grids.items()},
        trials=len(seeds),
        workspace_poses=asked.judged,
        **{name: Row({kind: own[name] for kind, own in kinds.items()}) for name in kinds["gravity"]},
        featured_poses=FEATURED_POSES,
        featured_um=UM * FEATURED_SIGMA,
        dataset=merged(known.pick(np.arange(1)))[0].measured,
    )
    featured = [c for c in f.cells.gravity if (c.poses, c.sigma_um) == (FEATURED_POSES, f.featured_um)]
    f |= {"gains": _gains(rows, featured), "models": _models(featured)}
    where = "A weight, {featured_poses} poses, {featured_um:g} um of noise, {gains.structure}:"
    worst = "{cell}, {sigma_um:g} um: GCO errs {gco_over_ls:~.2f} times"
    return Report(
        scenario=STUDY.name,
        question=Markdown("Where does the cone pay by itself?"),
        title=_title(f),
        answer=lines([say(where, f), *compare.beside_rivals(f.gains, "fit")]),
        worst=lines(
            [
                say(f"Worst under a weight: {worst} least squares.", f.worst.gravity),
                say(f"Under six wrenches: {worst}.", f.worst.full_pose),
            ]
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW],
    )


def _compared(trials: Trials) -> Trials:
    """With ratios of errors, and which is the smaller by more than a solver's last digits, fit by fit."""
    gco = trials["gco_um"]
    return trials.add(
        **{name: trials[ours] / trials[theirs] for name, (ours, theirs) in RATIOS.items()},
        **{name: trials[own] for name, own in SHARES.items()},
        better_in=gco < (1 - SAME) * trials["ls_um"],
        beats_joints_in=gco < (1 - SAME) * trials["joints_um"],
    )


def _fits(own: Trials, names: Sequence[str] = CELL) -> Row:
    """Numbers over some fits, and shares of them."""
    found = Row(fits=len(own))
    for name in names:
        found[name] = float(own[name].mean()) if own[name].dtype.kind == "b" else number(own[name])
    return found


def _of_kind(rows: Trials) -> Row:
    """All of one kind of reading, by its name in report.json."""
    plain = rows.where(uncertainty=NONE)
    by = ("kind", "structure", "poses", "sigma_um")
    cells = [
        Row(zip(by, key, strict=True), cell=f"{key[1]}, {key[2]} poses", **_fits(own))
        for key, own in plain.groups(*by)
    ]
    ratios = ("binds_in", "gco_over_ls", "gco_over_joints", "beats_joints_in")
    priors = [Row(_fits(rows.where(uncertainty=name), ratios), uncertainty=name) for name in PRIORS]
    return Row(
        cells=cells,
        counts=_counts(cells),
        levels=list(_levels(plain)),
        priors=priors,
        worst=max(cells, key=lambda cell: middle(cell.gco_over_ls)),
    )


def pays(ratio: Number) -> bool:
    """Whether a ratio of errors is below 1 in 95 % of the fits, and `MATTERS` at most in the middle."""
    return ends(ratio)[1] < 1 and middle(ratio) <= MATTERS


def costs(ratio: Number) -> bool:
    """Whether it is above 1 in as many, in the middle by as much."""
    return ends(ratio)[0] > 1 and middle(ratio) >= 1 / MATTERS


def _counts(cells: Sequence[Row]) -> Row:
    """How many cells do what; the cone by itself pays with the same free directions."""
    cone, own = ([c for c in cells if pays(c[name])] for name in ("gco_over_lent", "gco_over_ls"))
    cost = [cell for cell in cells if costs(cell.gco_over_ls)]
    return Row(
        cells=len(cells),
        cone_pays=len(cone),
        cone_pays_and_beats_joints=sum(cell.beats_joints_in > 0.5 for cell in cone),
        pay=len(own),
        pay_and_beat_joints=sum(cell.beats_joints_in > 0.5 for cell in own),
        cost=len(cost),
        cost_with_free=sum(middle(cell.free) > 0 for cell in cost),
    )


def _levels(plain: Trials) -> Iterator[Row]:
    """Where the cone binds, by the error to expect of least squares, ascending; and where it does not."""
    binding, expected = plain["binds"].astype(bool), plain["expected"]
    parts = {FREE: ~binding}
    for low, high in pairwise(LEVELS):
        name = f"{100 * low:g} to {100 * high:g} %" if high < np.inf else f"over {100 * low:g} %"
        parts[name] = binding & (low <= expected) & (expected < high)
    for name in (*list(parts)[1:], FREE):
        own = plain.pick(parts[name])
        if len(own):
            yield Row(kind=own["kind"][0], level=name, fits_share=len(own) / len(plain), **_fits(own))


def _gains(rows: Trials, featured: Sequence[Row]) -> Row:
    """The structure of least median GCO error in the featured cell, fit by fit."""
    best = min(featured, key=lambda cell: middle(cell.gco_um))
    alike = {name: best[name] for name in ("kind", "structure", "poses", "sigma_um")}
    own = rows.where(uncertainty=NONE, **alike)
    ours, *others = ((own[key] / UM * MM).tolist() for key in ("gco_um", "ls_um", "joints_um"))
    found = Row(structure=best.structure)
    for name, theirs in zip(("least squares", "joints alone"), others, strict=True):
        gain = gained("GCO", name, ours, theirs)
        found[name.removesuffix(" alone").replace(" ", "_")] = Row(vars(gain), alike=gain.alike)
    return found


def _models(featured: Sequence[Row]) -> list[Row]:
    """The models of the featured cell, without a prior."""
    found: list[tuple[str, Constraint, float | None, float, Number]] = []
    for c in featured:
        found += [
            (f"{c.structure}, least squares", "none", c.conservative_in, 1.0, c.ls_um),
            (f"{c.structure}, PSD of equal fit", "free", 1 - c.binds_in, 1.0, c.equal_um),
            (f"{c.structure}, GCO", "psd", 1.0, c.solved_in, c.gco_um),
        ]
    found.append(("Joints", "none", None, 1.0, featured[0].joints_um))
    return [
        Row(
            name=name,
            method=compare.METHODS[constraint],
            constraint=constraint,
            prior=False,
            conservative=conservative,
            solved=solved,
            workspace=Row(rms_mm=um.scaled(MM / UM) if isinstance(um, Spread) else MM / UM * middle(um)),
            check=None,
            paper=None,
        )
        for name, constraint, conservative, solved, um in found
    ]


def _tables(f: Row) -> dict[str, Table]:
    """A map of every kind of reading, and both by the error to expect."""
    cell, sigma, ratio = columns("cell sigma_um gco_over_ls")
    found = {
        kind: pivot(
            Table((), f.cells[kind], f"{words}: GCO over least squares, by noise"), cell, sigma, ratio
        )
        for kind, words in KINDS.items()
    }
    levels = [Row(row, level=f"{KINDS[kind]}: {row.level}") for kind in KINDS for row in f.levels[kind]]
    title = "By the error to expect of least squares, over the deflection"
    return found | {"levels": Table(columns(f"level {GROUP}"), levels, title)}


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
        also = "in {cone_pays_and_beats_joints} of these GCO beats joints alone"
        also = "in all of these joints alone are better" if never else also
        yield say(
            f"{capital(words)}: the cone by itself pays in {{cone_pays}} of {{cells}} cells; {also}.", own
        )
    if levels := [row for row in f.levels.gravity if row.level != FREE]:
        yield say(
            "It gains most where noise swamps least squares: {gco_over_lent:~.2f} times their error where "
            "noise costs {level} of the deflection, {low:~.2f} at {least}.",
            levels[-1],
            low=levels[0].gco_over_lent,
            least=levels[0].level,
        )


def figures(found: Report) -> dict[str, Figure]:
    """Maps of noise by poses, a structure and ratio each."""
    f, panes = Row(found.numbers), {}
    for kind, words in KINDS.items():
        for called, key in DRAWN.items():
            for structure in dict.fromkeys(cell.structure for cell in f.cells[kind]):
                own = [cell for cell in f.cells[kind] if cell.structure == structure]
                title = f"{words.partition(',')[0]}, {structure}: {called}"
                panes[title] = Table(columns(f"sigma_um poses {key}"), own)
    where = f"A weight, {f.featured_poses} poses, {f.featured_um:g} um of noise, {f.gains.structure}:"
    reading = (
        f"GCO's RMS error over the workspace over the other's, medians of {f.trials} trials, "
        f"{len(f.truth)} true arms in turn; below 1 GCO is better. Hatched: their "
        f"{span(f.gains.joints.trials)} holds 1. Framed: GCO beats joints alone in most trials."
    )
    answer = f"{where} {compare.gains_told(f.gains)}"
    return {"regimes.png": maps(panes, answer, reading, KNOWN["beats_joints_in"])}


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.gravity.arm))
    write_csv(trial.first_runs(cell, run.settings, run.seeds[0]), cell.arm, run.folder / "dataset.csv")


STUDY = Study(
    name="regimes",
    about="Map where GCO beats least squares of the same structure: noise, poses, structure, truth, prior.",
    options=Options,
    settings=trial.settings,
    seeds=(100, 2),
    arms=lambda asked: [find_arm(grid.arm) for grid in asked.grids.values()],
    row=trial.CellRow,
    trials=trial.trials,
    report=report,
    printed=tuple(KINDS),
    figures=figures,
    write=write,
)
