"""What the trials say: where GCO beats least squares of the same structure, and what the cone does of it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import build_cell
from testbench.bench.rows import MM, UM
from testbench.bench.truths import CALLED
from testbench.data.csvfile import write_csv
from testbench.errors import Array
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged, number
from testbench.studies.regimes.figure import maps
from testbench.studies.regimes.trial import (
    FEATURED_POSES,
    FEATURED_SIGMA,
    NONE,
    PRIORS,
    Settings,
    first_runs,
)
from testbench.studies.study import Run
from testbench.trials.gain import gained
from testbench.trials.spread import SAME, Number, Spread, ends, middle, most_trials, span
from testbench.views.figure import Figure
from testbench.views.gains import beside
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table, pivot

KINDS = {"gravity": "a weight, three markers", "full_pose": "six wrenches, full pose"}
"""Kinds of reading in words."""
LEVELS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, np.inf)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
FREE = "the cone does not bind"
METHODS = {"none": "least squares", "free": "least squares, conservative of equal fit", "psd": "GCO"}
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
GROUP = "fits_share gco_over_ls gco_over_lent better_in gco_over_joints beats_joints_in"
PRIOR = "binds_in gco_over_ls where_it_binds gco_over_joints beats_joints_in"
CELL = (
    f"{GROUP} gco_over_equal lent_over_ls fitted ls_um equal_um gco_um joints_um binds_in conservative_in "
    "solved_in expected rank free"
)
RATIO = "gco_over_ls gco_over_equal gco_over_lent gco_over_joints better_in binds_in fitted"
DRAWN = {"gravity": "gco_over_ls gco_over_equal gco_over_lent", "full_pose": "gco_over_ls gco_over_lent"}
"""Ratios that are mapped, by kind of reading."""
READING = Markdown(
    "## How to read the maps\n\n"
    "GCO and least squares of one structure differ in what they take for the directions that no reading "
    "sees, and in what the cone does to those that the data see.\n\n"
    "- PSD of equal fit: least squares whose free directions make it conservative, nearest to minimum norm; "
    "plain least squares where that cannot be.\n"
    "- Same free directions: least squares with the free directions of GCO. What is then left is the cone's "
    "own work.\n"
    "- The cone binds where no conservative model fits as well as least squares.\n"
    "- In the fitted runs, against the truth, the ratio is at most 1 where the structure holds the true arm "
    "and deflections are linear in the load: GCO's fit is then nearer in every arm.\n"
    "- Error to expect: what noise alone leaves least squares over the workspace, from rows and sigma, "
    "before any reading is seen; over the deflection that GCO predicts. Lines with percentages: where the "
    "cone binds.\n"
    "- Prior: the arm's folder, right where the true links are tubes. A line without noise is of all.\n\n"
    "Least squares weighs positions and rotations as GCO ends up weighing them, so that weights make no "
    "difference. Poses are nested and share their noise.\n\n"
    "Why: noise moves the fit of least squares in all directions that the data see. GCO keeps the part of it "
    "that a conservative model can have. Where a direction's compliance is far larger than its noise, that "
    "is all of it; where it is smaller, half of the noise would make an eigenvalue negative, and is cut off. "
    "Where directions are free, large compliances in these can make every fit conservative, and nothing is "
    "cut off."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by cell, level, truth and prior."""
    rows = _compared(trials)
    kinds = {kind: _of_kind(rows.where(kind=kind)) for kind in KINDS}
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
        dataset=_dataset(trials),
    )
    featured = [c for c in f.cells.gravity if (c.poses, c.sigma_um) == (FEATURED_POSES, f.featured_um)]
    f |= {"gains": _gains(rows, featured), "models": _models(featured)}
    return Report(
        scenario="regimes",
        question=Markdown("Where does the cone pay by itself?"),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=lines(_worst(f)),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[Markdown("![maps](regimes.png)"), READING, *tables],
    )


def _dataset(trials: Trials) -> Row:
    """What the first trial's dataset holds."""
    own = trials.keep("measured.")
    found: Row = merged(own.pick(np.isfinite(own["measured.runs"])).pick(np.arange(1)))[0].measured
    return found


def _compared(trials: Trials) -> Trials:
    """With ratios of errors, and which is the smaller by more than a solver's last digits, fit by fit."""
    gco = trials["gco_um"]
    return trials.add(
        **{name: trials[ours] / trials[theirs] for name, (ours, theirs) in RATIOS.items()},
        better_in=gco < (1 - SAME) * trials["ls_um"],
        beats_joints_in=gco < (1 - SAME) * trials["joints_um"],
        binds_in=trials["binds"],
        conservative_in=trials["conservative"],
        solved_in=trials["solved"],
    )


def _fits(own: Trials, names: str) -> Row:
    """Numbers over some fits, and shares of them."""
    found = Row(fits=len(own))
    for name in names.split():
        if name in own:
            cells = own[name]
            found[name] = float(cells.mean()) if cells.dtype.kind == "b" else number(cells)
    return found


def _of_kind(rows: Trials) -> Row:
    """All of one kind of reading, by its name in report.json."""
    plain, believed = rows.where(uncertainty=NONE), rows.where(uncertainty=set(PRIORS))
    binding, free = plain.pick(plain["binds"]), plain.pick(~plain["binds"])
    cells = [
        Row(kind=own["kind"][0], structure=name, poses=poses, sigma_um=sigma, **_fits(own, CELL))
        for (name, poses, sigma), own in plain.groups("structure", "poses", "sigma_um")
    ]
    for cell in cells:
        cell["cell"] = f"{cell.structure}, {cell.poses} poses"
    return Row(
        cells=cells,
        counts=_counts(cells),
        levels=list(_levels(binding, len(plain))),
        free=Row(level=FREE, fits_share=len(free) / len(plain), **_fits(free, GROUP)) if len(free) else None,
        truths=[
            Row(true_arm=arm, fits_share=len(own) / len(plain), **_fits(own, GROUP))
            for (arm,), own in plain.groups("true_arm")
        ],
        priors=[_with_prior(believed.where(uncertainty=name), uncertainty=name) for name in PRIORS],
        priors_by_noise=[
            _with_prior(believed.where(uncertainty=name, sigma_um=sigma), uncertainty=name, sigma_um=sigma)
            for name in PRIORS
            for sigma in sorted(believed.values("sigma_um"))
        ],
        explained=_explained(binding, cells),
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
    cone = [cell for cell in cells if pays(cell.gco_over_lent)]
    own = [cell for cell in cells if pays(cell.gco_over_ls)]
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


def _levels(binding: Trials, fits: int) -> Iterator[Row]:
    """Where the cone binds, by the error that noise is expected to leave least squares, ascending."""
    for low, high in pairwise(LEVELS):
        own = binding.pick((low <= binding["expected"]) & (binding["expected"] < high))
        if len(own):
            name = f"{100 * low:g} to {100 * high:g} %" if high < np.inf else f"over {100 * low:g} %"
            yield Row(level=name, fits_share=len(own) / fits, **_fits(own, GROUP))


def _with_prior(own: Trials, **known: float | str) -> Row:
    """GCO with prior over least squares with the same prior."""
    binding = own.pick(own["binds"])
    where = number(binding["gco_over_ls"]) if len(binding) else None
    return Row(known, where_it_binds=where, **_fits(own, PRIOR))


def _explained(binding: Trials, cells: Sequence[Row]) -> Row:
    """Rank correlations with GCO over least squares of the same free directions, where the cone binds.

    None where there is nothing to correlate; `expected_by_cell` of medians of cells in which it binds in
    most fits.
    """
    most = [cell for cell in cells if cell.binds_in > 0.5]
    medians = [np.array([middle(cell[name]) for cell in most]) for name in ("expected", "gco_over_lent")]
    gain = binding["gco_over_lent"]
    return Row(
        expected=rank_correlation(binding["expected"], gain),
        expected_by_cell=rank_correlation(*medians),
        taken=rank_correlation(binding["taken"], gain),
        noise=rank_correlation(binding["sigma_um"], gain),
        poses=rank_correlation(binding["poses"], gain),
    )


def rank_correlation(a: Array, b: Array) -> float | None:
    """Spearman's; None where one of them does not vary."""
    from scipy.stats import rankdata  # here: importing it takes longer than a trial's fits

    if min(len(set(a)), len(set(b))) < 2:
        return None
    return float(np.corrcoef(rankdata(a), rankdata(b))[0, 1])


def _gains(rows: Trials, featured: Sequence[Row]) -> Row:
    """The structure of least median GCO error in the featured cell, fit by fit."""
    best = min(featured, key=lambda cell: middle(cell.gco_um))
    alike = {name: best[name] for name in ("kind", "structure", "poses", "sigma_um")}
    own = rows.where(uncertainty=NONE, **alike)
    ours, ls, joints = ((own[key] / UM * MM).tolist() for key in ("gco_um", "ls_um", "joints_um"))
    return Row(
        structure=best.structure,
        least_squares=gained("GCO", "least squares", ours, ls),
        joints=gained("GCO", "joints alone", ours, joints),
    )


def _models(featured: Sequence[Row]) -> list[Row]:
    """The models of the featured cell, without a prior."""
    found: list[tuple[str, str, float | None, float, Number]] = []
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
            method=METHODS[constraint],
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
    """Map, every number, levels, truths and priors of every kind of reading."""
    found: dict[str, Table] = {}
    cell, sigma, ratio = columns("cell sigma_um gco_over_ls")
    for kind, words in KINDS.items():
        cells, free = f.cells[kind], [f.free[kind]] if f.free[kind] else []
        short = Table((), cells, f"{words}: GCO over least squares, median, by noise")
        found |= {
            f"{kind}_short": pivot(short, cell, sigma, replace(ratio, exact=True)),
            f"{kind}_levels": Table(
                columns(f"level {GROUP}"),
                [*f.levels[kind], *free],
                f"{words}: by the error to expect over the deflection",
            ),
            f"{kind}_truths": Table(columns(f"true_arm {GROUP}"), f.truths[kind], f"{words}: by true arm"),
            f"{kind}_priors": Table(
                columns(f"uncertainty sigma_um {PRIOR}"),
                [*f.priors[kind], *f.priors_by_noise[kind]],
                f"{words}: with a prior",
            ),
            f"{kind}_cells": Table(columns(f"cell sigma_um {RATIO}"), cells, f"{words}: every number"),
        }
    return found


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


def _answer(f: Row) -> Iterator[Markdown]:
    """GCO in the featured cell, beside least squares of its structure and the incumbent."""
    ls, joints = f.gains.least_squares, f.gains.joints
    yield say(
        "A weight, {featured_poses} poses, {featured_um:g} um of noise: GCO ({structure}) {ours:.0f} um, "
        "least squares {theirs:.0f} um; {gain:less}.",
        f,
        structure=f.gains.structure,
        ours=1e3 * middle(ls.ours_mm),
        theirs=1e3 * middle(ls.theirs_mm),
        gain=ls,
    )
    yield say(
        "Joints alone {theirs:.0f} um, {gain:more fit}.", theirs=1e3 * middle(joints.theirs_mm), gain=joints
    )


def _worst(f: Row) -> Iterator[Markdown]:
    """Where GCO costs most."""
    where = "{cell}, {sigma_um:g} um: GCO errs {gco_over_ls:~.2f} times"
    yield say(f"Worst under a weight: {where} least squares.", f.worst.gravity)
    yield say(f"Under six wrenches: {where}.", f.worst.full_pose)


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    for kind, words in KINDS.items():
        own = f.counts[kind]
        never = own.cone_pays and not own.cone_pays_and_beats_joints
        also = "in {cone_pays_and_beats_joints} of these GCO beats joints alone"
        also = "in all of these joints alone are better" if never else also
        yield say(f"{_up(words)}: the cone by itself pays in {{cone_pays}} of {{cells}} cells; {also}.", own)
    if levels := f.levels.gravity:
        yield say(
            "It gains most where noise swamps least squares: {gco_over_lent:~.2f} times their error where "
            "noise costs {level} of the deflection, {low:~.2f} at {least}.",
            levels[-1],
            low=levels[0].gco_over_lent,
            least=levels[0].level,
        )
    every = [claim for kind, words in KINDS.items() for claim in _of_free(f, kind, _up(words))]
    yield from every[:1]
    yield say(
        "Under a weight, with a prior of {uncertainty} uncertainty, the cone binds in {binds_in:yes} of the "
        "fits; GCO beats joints alone in {beats_joints_in:yes}.",
        f.priors.gravity[0],
    )
    yield from every[1:]


def _up(words: str) -> str:
    return words[:1].upper() + words[1:]


def _of_free(f: Row, kind: str, words: str) -> Iterator[Markdown]:
    """What free directions add, and what the cone's gain goes with."""
    yield say(
        f"{words}: free directions included, GCO pays in {{pay}} of {{cells}} cells "
        "({pay_and_beat_joints} where it beats joints alone). It costs in {cost}, {cost_with_free} of them "
        "with directions free.",
        f.counts[kind],
    )
    if f.free[kind]:
        yield say(
            f"{words}: in {{fits_share:yes}} of the fits some conservative model fits as well as least "
            "squares. There the cone does nothing to what is seen: GCO over least squares is "
            "{gco_over_lent:.2f} with the same free directions, with what GCO takes for these "
            "{gco_over_ls:.2f}.",
            f.free[kind],
        )
    yield say(
        f"{words}: where the cone binds, its gain goes with the error to expect of least squares over the "
        "deflection: rank correlation {expected:+.2f} fit by fit, {expected_by_cell:+.2f} cell by cell. With "
        "the noise alone it is {noise:+.2f}, with the number of poses {poses:+.2f}, with chi squared that "
        "the cone adds {taken:+.2f}.",
        f.explained[kind],
    )


def figures(found: Report) -> dict[str, Figure]:
    """Maps of noise by poses."""
    f = Row(found.numbers)
    gains = {"least squares": f.gains.least_squares, "joints alone": f.gains.joints}
    drawn = {KINDS[kind]: (f.cells[kind], columns(keys)) for kind, keys in DRAWN.items()}
    return {
        "regimes.png": maps(
            drawn,
            f"A weight, {f.featured_poses} poses, {f.featured_um:g} um of noise, {f.gains.structure}: "
            f"{beside(gains, 'um')}",
            f"Numbers: GCO's RMS error over the workspace over the other's, medians of {f.trials} trials, "
            f"{len(f.truth)} true arms in turn. Hatched: their {span(f.gains.joints.trials)} holds 1. "
            "Framed: GCO beats joints alone in most trials.",
        )
    }


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    cell = build_cell(find_arm(run.settings.gravity.arm))
    write_csv(first_runs(cell, run.settings, run.seeds[0]), cell.arm, run.folder / "dataset.csv")
