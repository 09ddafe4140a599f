"""The report of section 5.1: medians, spreads and shares over all draws of noise."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.rows import MM, UM, dataset_row
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.factorised import order_range
from testbench.studies.paper import EQ_22, EQ_23, RULE
from testbench.studies.single_link.judge import absolute, eigenvalues, judge
from testbench.studies.single_link.order import orders, ranks, share, which_m
from testbench.studies.single_link.printed import printed_matrices, with_eigenvalues
from testbench.studies.single_link.report import (
    Gains,
    LinkDataset,
    LinkModel,
    LinkReport,
    Paired,
    Printed,
    WorstEntry,
)
from testbench.studies.single_link.trial import (
    GCO,
    LEAST_SQUARES,
    NAME,
    SYMMETRIC,
    Draw,
    LinkRow,
    Settings,
    measure,
    models,
)
from testbench.studies.single_link.verdict import claims
from testbench.studies.study import Rows
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import grouped, merge, middle, wins
from testbench.views.schema import best_of

HALF = 3  #: Entries of translation, as many of rotation.
SHARES = ("conservative", "symmetric", "negative_eigenvalue", "negative_eigenvalue_matrix")


def summary(asked: Settings, seeds: range, trials: Rows[LinkRow]) -> LinkReport:
    """Medians and spreads of every model and order; truth values as shares of the draws."""
    cell = build_cell(find_arm(NAME))
    draws = [list(rows) for _, rows in trials]
    by_name = grouped([row for rows in draws for row in rows if row.m is None], lambda row: row.name)
    first = measure(cell, asked, seeds[0])
    printed = printed_matrices(cell, asked, first.truth)
    known = _printed(cell, first.truth, printed.eq_23_from_the_data_of_eq_22.printed_f_m)
    found = [_model(cell, rows, known.get(name)) for name, rows in by_name.items()]
    allowed = order_range(models(cell)[-1].structure, first.identification.runs)
    by_order, ordered = orders(draws), sum(len(rows) > len(found) for rows in draws)
    paired = {other: _paired(by_name[GCO], by_name[other]) for other in (LEAST_SQUARES, SYMMETRIC)}
    report = LinkReport(
        scenario=NAME,
        seed=seeds[0],
        draws=len(draws),
        arm=asked.campaign.arm,
        truth=asked.campaign.truth,
        noise=asked.campaign.noise,
        noise_per="deflection",
        loads=asked.loads,
        condition_of_the_loads=merge([row.condition for row in by_name[GCO]]),
        dataset=_dataset(asked, first),
        models=found,
        best_position=best_of({m.name: m.prediction.position_rms_um for m in found}).names,
        best_rotation=best_of({m.name: m.prediction.rotation_rms_urad for m in found}).names,
        gains=Gains(*(_gain(by_name[GCO], by_name[other]) for other in (LEAST_SQUARES, SYMMETRIC))),
        worst=worst(cell.arm.C_theta, *(next(m for m in found if m.name == n) for n in (GCO, LEAST_SQUARES))),
        paired=paired,
        order_draws=ordered,
        order_range=allowed,
        order=by_order,
        eq_22_23=printed,
        first_draw={name: with_eigenvalues(rows[0].matrix) for name, rows in by_name.items()},
        truth_matrix=cell.arm.C_theta.tolist(),
        units="matrices: m/N, 1/N, rad/(N m); eigenvalues in these mixed units, as the paper's",
        which_m=which_m(by_order, allowed, ordered),
        claims=[],
        rule=RULE,
    )
    return replace(report, claims=claims(report))


def _dataset(asked: Settings, draw: Draw) -> LinkDataset:
    um, urad = UM * asked.campaign.sigma, UM * asked.campaign.sigma_rotation
    twice = math.sqrt(2)
    return LinkDataset(
        **vars(dataset_row(draw.identification)),
        check_runs=draw.truth.runs,
        sigma_urad=urad,
        sigma_of_a_deflection_um=twice * um,
        sigma_of_a_deflection_urad=twice * urad,
    )


def _model(cell: Cell, rows: Sequence[LinkRow], paper: Printed | None) -> LinkModel:
    known = vars(merge(rows)) | {key: share([getattr(row, key) for row in rows]) for key in SHARES}
    for key in ("m", "condition", "C"):
        del known[key]
    error = np.array([row.matrix for row in rows]) - cell.arm.C_theta
    return LinkModel(
        **known | {"rank_of_C": ranks(rows)},
        entry_rms=np.sqrt((error**2).mean(axis=0)).tolist(),
        entry_bias=error.mean(axis=0).tolist(),
        min_eigenvalues=[float(eigenvalues(row.matrix)[0][0]) for row in rows],
        paper=paper,
    )


def _printed(cell: Cell, truth: Dataset, f_m: float) -> dict[str, Printed]:
    """Eq. (22) fits its own data exactly; whether Eq. (23) is negative lies below its printed digits."""
    ls, ours = (vars(judge(cell, np.array(C), truth)) for C in (EQ_22, EQ_23))
    unknown = {"negative_eigenvalue": None, "negative_eigenvalue_matrix": None}
    return {
        LEAST_SQUARES: Printed(**ls, conservative=ls["symmetric"], f_m=0.0),
        GCO: Printed(**ours | unknown, conservative=ours["symmetric"], f_m=f_m),
    }


def _paired(ours: Sequence[LinkRow], theirs: Sequence[LinkRow]) -> Paired:
    pairs = [(absolute(a), absolute(b)) for a, b in zip(ours, theirs, strict=True)]
    better = {key: wins([a[key] for a, _ in pairs], [b[key] for _, b in pairs]) for key in pairs[0][0]}
    return Paired(len(pairs), better)


def _gain(ours: Sequence[LinkRow], theirs: Sequence[LinkRow]) -> Gain:
    """By position errors, draw by draw."""
    a, b = ([middle(row.prediction.position_rms_um) / UM * MM for row in rows] for rows in (ours, theirs))
    return gained(ours[0].name, theirs[0].name, a, b)


def worst(C: Array, ours: LinkModel, theirs: LinkModel) -> WorstEntry:
    """The entry on the diagonal that GCO finds worst, over its true value."""
    errors = [np.diag(model.entry_rms) for model in (ours, theirs)]
    k = int(np.argmax(errors[0] / np.diag(C)))
    unit = "um/N" if k < HALF else "urad/(N m)"
    return WorstEntry(f"c{k + 1}{k + 1}", unit, *(UM * float(own[k]) for own in (np.diag(C), *errors)))
