"""What the draws of noise say: every method, the order m, and the paper's statements judged."""

import math
from collections.abc import Iterator

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Cell, build_cell
from testbench.campaign.rows import UM, dataset_row
from testbench.data.write import write_csv
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Cells, Row, Trials, aligned, find, merged, number, paired
from testbench.studies import paper
from testbench.studies.estimators.factorised import order_range
from testbench.studies.single_link.trial import (
    GCO,
    LEAST_SQUARES,
    NAME,
    SYMMETRIC,
    Draw,
    Settings,
    judge,
    measure,
    models,
)
from testbench.studies.study import Run
from testbench.trials.spread import span, wins
from testbench.views.figure import Figure, forest
from testbench.views.gains import beside
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table, best_of, show_truth

POSITION, ROTATION = "prediction.position_rms_um", "prediction.rotation_rms_urad"
ENTRIES = (
    "entries.translation_rms_um_per_N",
    "entries.coupling_translation_rms_um_per_Nm",
    "entries.coupling_rotation_rms_urad_per_N",
    "entries.rotation_rms_urad_per_Nm",
)
SHARES = ("conservative", "symmetric", "negative_eigenvalue", "negative_eigenvalue_matrix")
SHAPE = (
    "name conservative symmetric negative_eigenvalue_matrix negative_eigenvalue matrix_eigenvalue_micro "
    "symmetric_eigenvalue_micro f_m f_m_floor"
)
ERRORS = (
    f"name {POSITION} prediction.position_relative_percent {ROTATION} prediction.rotation_relative_percent "
    f"{' '.join(ENTRIES)}"
)
OF_AN_ORDER = ("f_m_over_optimum", "excess_percent", "reaches_optimum")
ORDER = f"m f_m excess_percent reaches_optimum {POSITION} {ROTATION}"
OTHERS = {LEAST_SQUARES: "least squares", SYMMETRIC: "least squares with a symmetric matrix"}
HALF = 3  #: Entries of translation, as many of rotation.
OF_SHAPE = Markdown(
    "In square brackets: the paper's printed matrix, Eq. (22) or Eq. (23), a single draw. The sign of the "
    "smallest eigenvalue of Eq. (23) lies below its printed digits. MLS21 is not in the paper: least "
    "squares with symmetry and nothing else. A link has no joints: there is no model of joint stiffness "
    "only to compare with. F_M of MLS36 is 0 whatever the noise: 36 equations determine 36 unknowns."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every method and order; truth values as shares of the draws."""
    cell = build_cell(find_arm(NAME))
    first = measure(cell, asked, seeds[0])
    searched = trials.pick(trials["m"] > 0)
    f = Row(
        seed=seeds[0],
        draws=len(seeds),
        arm=asked.campaign.arm,
        truth=asked.campaign.truth,
        noise=asked.campaign.noise,
        noise_per="deflection",
        loads=asked.loads,
        dataset=_dataset(asked, first),
        order_range=order_range(models(cell)[-1].structure, first.identification.runs),
        rule=paper.RULE,
        **_found(cell, trials.where(m=0), first),
        order_draws=len(searched.values("seed")),
        order=[_order(own) for _, own in searched.groups("m")],
    )
    f |= {"worst": _worst_entry(f, cell), "which_m": _which_m(f), "claims": list(_judged(f))}
    return Report(
        scenario=NAME,
        question=Markdown(
            "Single link, section 5.1: is a conservative compliance nearer the truth than least squares?"
        ),
        title=_title(f),
        answer=_answer(f),
        worst=say(
            "Worst entry is {name}, {true:.3f} {unit}: GCO errs {gco:.3f} {unit} RMS, least squares "
            "{least_squares:.3f}.",
            f.worst,
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "shape": Table(columns(SHAPE), f.models, "What kind of matrix"),
            "errors": Table(columns(ERRORS), f.models, "How far off", headline=POSITION),
            "claims": Table(columns("claim verdict why"), f.claims, "The paper's statements"),
            "order": Table(columns(ORDER, paper=False), f.order, "The order m, Eq. (20)"),
        },
        body=["shape", OF_SHAPE, "errors", _of_errors(f), "claims", Markdown(paper.RULE), "order"],
    )


def _dataset(asked: Settings, draw: Draw) -> Row:
    """The readings of the first draw, and the noise of a reading and of a deflection."""
    um, urad = UM * asked.campaign.sigma, UM * asked.campaign.sigma_rotation
    return Row(
        vars(dataset_row(draw.identification)),
        check_runs=draw.truth.runs,
        sigma_urad=urad,
        sigma_of_a_deflection_um=math.sqrt(2) * um,
        sigma_of_a_deflection_urad=math.sqrt(2) * urad,
    )


def _found(cell: Cell, trials: Trials, first: Draw) -> Row:
    """Every method over all draws, and GCO beside the others in the same draws."""
    ls, gco = (Row(vars(judge(cell, np.array(C), first.truth))) for C in (paper.EQ_22, paper.EQ_23))
    unknown = {"negative_eigenvalue": None, "negative_eigenvalue_matrix": None}  # below the printed digits
    printed = {
        LEAST_SQUARES: Row(ls, conservative=ls.symmetric, f_m=0.0),
        GCO: Row(gco | unknown, conservative=gco.symmetric),
    }
    every = [_model(cell, own, printed.get(name)) for (name,), own in trials.groups("name")]
    better = {
        other: {
            key.rpartition(".")[2]: wins(*aligned(trials, (GCO, other), key).T)
            for key in (POSITION, ROTATION, *ENTRIES)
        }
        for other in OTHERS
    }
    return Row(
        models=every,
        condition_of_the_loads=number(trials.where(name=GCO)["condition"]),
        best_position=best_of({m.name: m.prediction.position_rms_um for m in every}).names,
        best_rotation=best_of({m.name: m.prediction.rotation_rms_urad for m in every}).names,
        gains=Row(
            least_squares=paired(trials, GCO, LEAST_SQUARES, POSITION, 1e-3),
            symmetric=paired(trials, GCO, SYMMETRIC, POSITION, 1e-3),
        ),
        paired=Row(
            {other: Row(draws=len(trials.values("seed")), gco_better=own) for other, own in better.items()}
        ),
    )


def _model(cell: Cell, trials: Trials, printed: Row | None) -> Row:
    [m] = merged(trials.drop("seed", "m", "condition", "C", "eigenvalues", *OF_AN_ORDER))
    error = np.array(trials["C"].tolist()).reshape(-1, 6, 6) - cell.arm.C_theta
    return Row(
        m | {key: float(m[key]) for key in SHARES},
        rank_of_C=_counts(trials["rank_of_C"]),
        entry_rms=np.sqrt((error**2).mean(axis=0)).tolist(),
        entry_bias=error.mean(axis=0).tolist(),
        paper=printed,
    )


def _order(trials: Trials) -> Row:
    [row] = merged(trials.keep("m", "name", "f_m", *OF_AN_ORDER, "conservative", "prediction."))
    shares = {key: float(row[key]) for key in ("reaches_optimum", "conservative")}
    return Row(row | shares, rank_of_C=_counts(trials["rank_of_C"]))


def _counts(ranks: Cells) -> dict[str, int]:
    """Draws by rank of C."""
    return {str(rank): int(count) for rank, count in zip(*np.unique(ranks, return_counts=True), strict=True)}


def _named(f: Row) -> Row:
    """The methods by what they are called in words."""
    called = {"ls": LEAST_SQUARES, "symmetric": SYMMETRIC, "ours": GCO}
    return Row({key: find(f.models, name=name) for key, name in called.items()})


def _worst_entry(f: Row, cell: Cell) -> Row:
    """The entry on the diagonal of C that GCO finds worst, over its true value; RMS errors in the unit."""
    by = _named(f)
    true, gco, theirs = (np.diag(C) for C in (cell.arm.C_theta, by.ours.entry_rms, by.ls.entry_rms))
    k = int(np.argmax(gco / true))
    unit = "um/N" if k < HALF else "urad/(N m)"
    sizes = {"true": true, "gco": gco, "least_squares": theirs}
    return Row(name=f"c{k + 1}{k + 1}", unit=unit, **{key: UM * float(own[k]) for key, own in sizes.items()})


def _sure(f: Row) -> list[int]:
    """Orders that reach the optimum in every draw."""
    return [int(row.m) for row in f.order if row.reaches_optimum == 1]


def _which_m(f: Row) -> Markdown:
    """Which order to take."""
    first = (
        "Take m = {m}, the least that reaches the certified optimum of F_M in all {order_draws} draws."
        if _sure(f)
        else "No order m reaches the certified optimum of F_M in all {order_draws} draws."
    )
    low, high = f.order_range
    return say(
        f"{first} Eq. (20) allows {{low:g}} to {{high:g}}.", f, m=min(_sure(f), default=0), low=low, high=high
    )


def _title(f: Row) -> Markdown:
    """What was measured."""
    loads = "10 N or 10 N m along one axis" if f.loads == "axes" else "random within 10 N and 10 N m"
    if f.loads == "random":
        loads += ", condition number {condition_of_the_loads:.1f}"
    return say(
        f"Single link, Eq. (21): {{dataset.runs}} loads ({loads}), noise of a deflection "
        f"{{dataset.sigma_of_a_deflection_um:g}} um and {{dataset.sigma_of_a_deflection_urad:g}} urad; "
        f"{{n}} from seed {{seed}}{f': median ({span(f.draws)})' * (f.draws > 1)}",
        f,
        n=counted(f.draws, "draw"),
    )


def _answer(f: Row) -> Markdown:
    return say(
        "Position error: GCO {ours.prediction.position_rms_um:~.1f} um, least squares "
        "{ls.prediction.position_rms_um:~.1f} um; {gain:less draw}. Conservative in "
        "{ours.conservative:yes} of {draws} draws with GCO, in {ls.conservative:yes} with least squares of "
        "36 free entries, in {symmetric.conservative:yes} of 21 symmetric ones.",
        _named(f),
        gain=f.gains.least_squares,
        draws=f.draws,
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say(
        "Least squares of a symmetric matrix (MLS21) errs {prediction.position_rms_um:~.1f} um: "
        "{gain:more draw}.",
        _named(f).symmetric,
        gain=f.gains.symmetric,
    )
    yield say(
        "GCO is nearer the truth than MLS21 in {position_rms_um} of {draws} draws in position, in "
        "{rotation_rms_urad} in rotation; nearer than MLS36 in {ls.position_rms_um} and "
        "{ls.rotation_rms_urad}.",
        f.paired[SYMMETRIC].gco_better,
        ls=Row(f.paired[LEAST_SQUARES].gco_better),
        draws=f.draws,
    )
    yield f.which_m


def _of_errors(f: Row) -> Markdown:
    by = _named(f)
    return say(
        "Errors of predictions are RMS distances from the true deflection, without the noise of readings, "
        "which would add {noise:.0f} um in quadrature. The loads are fresh, spread evenly over |F| <= 10 N "
        "and |M| <= 10 N m. Errors of C are RMS over the nine entries of a block. In square brackets: the "
        "printed matrices under the check loads of our first draw. GCO pays with a bias where the truth is "
        "near zero: its c11 is {ours:.2f} um/N too large in the mean, that of least squares {ls:.2f}.",
        noise=f.dataset.sigma_of_a_deflection_um * math.sqrt(3),
        ours=UM * by.ours.entry_bias[0][0],
        ls=UM * by.ls.entry_bias[0][0],
    )


def _judged(f: Row) -> Iterator[Row]:
    """The paper's statements of section 5.1, and one of ours, each with our numbers."""
    by = _named(f)
    for m, share, claim in (
        (by.ours, 1, "GCO gives a conservative matrix (Eq. 23)"),
        (by.ls, 0, "least squares does not (Eq. 22); noise makes 36 free entries unsymmetric"),
        (by.symmetric, 0, "least squares with a symmetric matrix never does either (not in the paper)"),
    ):
        yield paper.judged(
            claim, m.conservative == share, f"conservative in {show_truth(m.conservative)} of the draws"
        )
    for other, words in OTHERS.items():
        held, test = f.paired[other].gco_better["position_rms_um"], "its position error is the smaller one"
        yield paper.comparison(f"GCO predicts better than {words}", test, held, f.draws)
    low, high = f.order_range
    failing = [f"m = {row.m}" for row in f.order if row.m >= low and row.m not in _sure(f)]
    yield paper.judged(
        f"any order m that Eq. (20) allows, {low:g} to {high:g}, will do",
        not failing,
        f"not in every draw at the optimum: {', '.join(failing) or 'none'}",
    )


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every method in position, rotation and the entries of C."""
    f = Row(found.numbers)
    by, loads = _named(f), "axis" if f.loads == "axes" else f.loads
    negative = [f"{100 * m.negative_eigenvalue_matrix:.4g} %" for m in (by.ours, by.ls)]
    answer = (
        f"Single link, position error: {beside({'least squares': f.gains.least_squares}, 'um')}; a negative "
        f"eigenvalue in {' and '.join(negative)} of the draws"
    )
    reading = (
        f"Section 5.1, {loads} loads. Dots: medians, lines: {span(f.draws)} of {f.draws} draws; grey "
        "diamonds: the paper's printed matrices. Dotted line: least squares with a symmetric matrix."
    )
    panes = {POSITION: "position", ROTATION: "rotation", ENTRIES[0]: "entries of C, force to position"}
    return {"single_link.png": forest(found.tables["errors"], panes, answer, reading, SYMMETRIC)}


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first draw."""
    draw = measure(build_cell(find_arm(NAME)), run.settings, run.seeds[0])
    write_csv(draw.identification, (), run.folder / "dataset.csv")
