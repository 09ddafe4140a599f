"""The report of the study of regimes: where GCO beats least squares of the same structure, and why."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from testbench.bench.rows import UM
from testbench.errors import Array
from testbench.identify import Constraint
from testbench.report.campaigns import METHODS
from testbench.studies.regimes.report import (
    Counts,
    Explained,
    FeaturedModel,
    Gains,
    Level,
    MapCell,
    Ratios,
    RegimesReport,
    Scores,
    WithPrior,
)
from testbench.studies.regimes.trial import (
    FEATURED_POSES,
    FEATURED_SIGMA,
    NAME,
    NONE,
    PRIORS,
    CellRow,
    Settings,
)
from testbench.studies.study import Rows
from testbench.trials.gain import gained
from testbench.trials.spread import SAME, Spread, grouped, spread

LEVELS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, np.inf)
"""Errors to expect of least squares by noise, over the deflection, between which fits are sorted."""
FREE = "the cone does not bind"


def summary(asked: Settings, seeds: range, trials: Rows[CellRow]) -> RegimesReport:
    """Medians and spreads by cell, level, truth and prior."""
    rows = [row for _, own in trials for row in own]
    plain = grouped([row for row in rows if row.prior == NONE], lambda row: row.kind)
    believed = grouped([row for row in rows if row.prior != NONE], lambda row: row.kind)
    cells = {kind: map_of(own) for kind, own in plain.items()}
    return RegimesReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        noise=True,
        truth=asked.truths,
        arms={kind: grid.arm for kind, grid in asked.grids.items()},
        trials=len(seeds),
        workspace_poses=asked.judged,
        cells=cells,
        counts={kind: counts(own) for kind, own in cells.items()},
        levels={kind: levels(own) for kind, own in plain.items()},
        free={kind: free(own) for kind, own in plain.items()},
        truths={kind: _levels(own, lambda row: row.truth, len(own)) for kind, own in plain.items()},
        priors={kind: priors(own) for kind, own in believed.items()},
        priors_by_noise={kind: priors_by_noise(own) for kind, own in believed.items()},
        explained={kind: explained(own, cells[kind]) for kind, own in plain.items()},
        worst={kind: max(own, key=lambda cell: cell.gco_over_ls.median) for kind, own in cells.items()},
        featured_poses=FEATURED_POSES,
        featured_um=UM * FEATURED_SIGMA,
        gains=gains(plain["gravity"]),
        models=featured(cells["gravity"]),
        dataset=next(row.measured for row in rows if row.measured is not None),
    )


def map_of(rows: Iterable[CellRow]) -> list[MapCell]:
    """A cell a structure, number of poses and noise."""
    groups = grouped(rows, lambda row: (row.structure, row.poses, row.noise_um))
    return [_cell(own) for own in groups.values()]


def _cell(rows: Sequence[CellRow]) -> MapCell:
    first, ls, gco = rows[0], _column(rows, "ls_um"), _column(rows, "gco_um")
    equal, lent = _column(rows, "equal_um"), _column(rows, "lent_um")
    return MapCell(
        **vars(_ratios(rows)),
        kind=first.kind,
        structure=first.structure,
        poses=first.poses,
        noise_um=first.noise_um,
        gco_over_equal=_spread(gco / equal),
        lent_over_ls=_spread(lent / ls),
        fitted=_spread(_column(rows, "gco_fitted_um") / _column(rows, "ls_fitted_um")),
        ls_um=_spread(ls),
        equal_um=_spread(equal),
        gco_um=_spread(gco),
        joints_um=_spread(_column(rows, "joints_um")),
        binds_in=float(np.mean(_column(rows, "binds"))),
        conservative_in=float(np.mean(_column(rows, "conservative"))),
        solved_in=float(np.mean(_column(rows, "solved"))),
        expected=_spread(_column(rows, "expected")),
        rank=_spread(_column(rows, "rank")),
        free=_spread(_column(rows, "free")),
    )


def _ratios(rows: Sequence[CellRow]) -> Ratios:
    ls, gco, joints = (_column(rows, key) for key in ("ls_um", "gco_um", "joints_um"))
    return Ratios(
        fits=len(rows),
        gco_over_ls=_spread(gco / ls),
        gco_over_lent=_spread(gco / _column(rows, "lent_um")),
        gco_over_joints=_spread(gco / joints),
        better_in=better(gco, ls),
        beats_joints_in=better(gco, joints),
    )


def better(ours: Array, theirs: Array) -> float:
    """Share of fits in which ours is the smaller by more than a solver's last digits."""
    return float(np.mean(ours < (1 - SAME) * theirs))


def counts(cells: Sequence[MapCell]) -> Counts:
    """What the cells of a map do."""
    cost = [c for c in cells if c.costs]
    return Counts(
        cells=len(cells),
        cone_pays=sum(c.cone_pays for c in cells),
        cone_pays_and_beats_joints=sum(c.cone_pays and c.beats_joints for c in cells),
        pay=sum(c.pays for c in cells),
        pay_and_beat_joints=sum(c.pays and c.beats_joints for c in cells),
        cost=len(cost),
        cost_with_free=sum(c.free.median > 0 for c in cost),
    )


def levels(rows: Sequence[CellRow]) -> list[Level]:
    """Where the cone binds, by the error that noise is expected to leave least squares, ascending."""
    names = {
        low: f"{100 * low:g} to {100 * high:g} %" if high < np.inf else f"over {100 * low:g} %"
        for low, high in pairwise(LEVELS)
    }
    order = list(names.values())

    def name(row: CellRow) -> str:
        return names[LEVELS[int(np.searchsorted(LEVELS, row.expected, side="right")) - 1]]

    binding = [row for row in rows if row.binds]
    return sorted(_levels(binding, name, len(rows)), key=lambda level: order.index(level.name))


def free(rows: Sequence[CellRow]) -> Level | None:
    """Where the cone does not bind; None where it always does."""
    own = [row for row in rows if not row.binds]
    return next(iter(_levels(own, lambda _: FREE, len(rows))), None)


def _levels(rows: Sequence[CellRow], name: Callable[[CellRow], str], of: int) -> list[Level]:
    found = grouped(rows, name)
    return [Level(**vars(_ratios(own)), name=k, share=len(own) / of) for k, own in found.items()]


def priors(rows: Iterable[CellRow]) -> list[WithPrior]:
    """By how firmly the prior is believed."""
    groups = grouped(rows, lambda row: row.prior)
    return [replace(_with_prior(groups[name]), noise_um=None) for name in PRIORS]


def priors_by_noise(rows: Iterable[CellRow]) -> list[WithPrior]:
    """By how firmly the prior is believed and by noise."""
    groups, order = grouped(rows, lambda row: (row.prior, row.noise_um)), list(PRIORS)
    return [_with_prior(groups[key]) for key in sorted(groups, key=lambda key: (order.index(key[0]), key[1]))]


def _with_prior(rows: Sequence[CellRow]) -> WithPrior:
    ls, gco, joints = (_column(rows, key) for key in ("ls_um", "gco_um", "joints_um"))
    binds = _column(rows, "binds") > 0
    return WithPrior(
        prior=rows[0].prior,
        noise_um=rows[0].noise_um,
        fits=len(rows),
        binds_in=float(binds.mean()),
        gco_over_ls=_spread(gco / ls),
        where_it_binds=_spread((gco / ls)[binds]) if binds.any() else None,
        gco_over_joints=_spread(gco / joints),
        beats_joints_in=better(gco, joints),
    )


def explained(rows: Sequence[CellRow], cells: Sequence[MapCell]) -> Explained:
    """Of the fits in which the cone binds, and of the cells in which it does in most."""
    binding = [row for row in rows if row.binds]
    gain = _column(binding, "gco_um") / _column(binding, "lent_um")
    most = [cell for cell in cells if cell.binds_in > 0.5]
    return Explained(
        expected=rank_correlation(_column(binding, "expected"), gain),
        expected_by_cell=rank_correlation(
            np.array([cell.expected.median for cell in most]),
            np.array([cell.gco_over_lent.median for cell in most]),
        ),
        taken=rank_correlation(_column(binding, "taken"), gain),
        noise=rank_correlation(_column(binding, "noise_um"), gain),
        poses=rank_correlation(_column(binding, "poses"), gain),
    )


def rank_correlation(a: Array, b: Array) -> float | None:
    """Spearman's; None where one of them does not vary."""
    from scipy.stats import rankdata  # here: importing it takes longer than a trial's fits

    if min(len(set(a)), len(set(b))) < 2:
        return None
    return float(np.corrcoef(rankdata(a), rankdata(b))[0, 1])


def featured(cells: Sequence[MapCell]) -> list[FeaturedModel]:
    """The models of the featured cell, without a prior."""
    own = [c for c in cells if c.poses == FEATURED_POSES and c.noise_um == UM * FEATURED_SIGMA]
    found = []
    for cell in own:
        found += [
            _model(f"{cell.structure}, least squares", "none", cell.conservative_in, cell.ls_um),
            _model(f"{cell.structure}, PSD of equal fit", "free", 1 - cell.binds_in, cell.equal_um),
            replace(_model(f"{cell.structure}, GCO", "psd", 1.0, cell.gco_um), solved=cell.solved_in),
        ]
    return [*found, _model("Joints", "none", None, own[0].joints_um)]


def gains(rows: Sequence[CellRow]) -> Gains:
    """The structure of least median GCO error in the featured cell."""
    own = [row for row in rows if row.poses == FEATURED_POSES and row.noise_um == UM * FEATURED_SIGMA]
    by_structure = grouped(own, lambda row: row.structure)
    name = min(by_structure, key=lambda n: float(np.median(_column(by_structure[n], "gco_um"))))
    ours, ls, joints = (
        (_column(by_structure[name], key) / 1e3).tolist() for key in ("gco_um", "ls_um", "joints_um")
    )
    return Gains(name, gained("GCO", "least squares", ours, ls), gained("GCO", "joints alone", ours, joints))


def _model(name: str, constraint: Constraint, conservative: float | None, error_um: Spread) -> FeaturedModel:
    error = error_um.scaled(1e-3)
    return FeaturedModel(name, METHODS[constraint], constraint, False, conservative, True, Scores(error))


def _column(rows: Sequence[CellRow], key: str) -> Array:
    return np.array([getattr(row, key) for row in rows], dtype=float)


def _spread(values: Array) -> Spread:
    return spread(values.tolist())
