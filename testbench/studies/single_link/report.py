"""What the draws of noise say: every method, the order m, and the paper's statements judged."""

import math
from collections.abc import Iterator

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.rows import UM, dataset_row
from testbench.data.csvfile import write_csv
from testbench.identify.factorised import order_range
from testbench.report.columns import SI, columns
from testbench.report.report import Report, say
from testbench.report.table import Cells, Row, Trials, aligned, merged, number, paired
from testbench.studies import paper
from testbench.studies.single_link import printed
from testbench.studies.single_link.figure import single_link
from testbench.studies.single_link.judge import judge
from testbench.studies.single_link.trial import (
    GCO,
    LEAST_SQUARES,
    NAME,
    SYMMETRIC,
    Draw,
    Settings,
    measure,
    models,
)
from testbench.studies.study import Run
from testbench.trials.spread import span, wins
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Column, Table, best_of, show_truth

POSITION, ROTATION = "prediction.position_rms_um", "prediction.rotation_rms_urad"
QUANTITIES = (
    POSITION,
    ROTATION,
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
    f"{' '.join(QUANTITIES[2:])}"
)
RECORDED = f"name conservative symmetric negative_eigenvalue_matrix {POSITION} {ROTATION}"
ORDER = f"m f_m excess_percent reaches_optimum {POSITION} {ROTATION}"
OWN = "m f_m rms_to_eq_23_over_sigma"
OTHERS = {LEAST_SQUARES: "least squares", SYMMETRIC: "least squares with a symmetric matrix"}
AXES = ("x", "y", "z", "phi_x", "phi_y", "phi_z")
HALF = 3  #: Entries of translation, as many of rotation.
OF_SHAPE = Markdown(
    "In square brackets: the paper's printed matrix, Eq. (22) or Eq. (23), a single draw. The sign of the "
    "smallest eigenvalue of Eq. (23) lies below its printed digits. MLS21 is not in the paper: least "
    "squares with symmetry and nothing else. A link has no joints: there is no model of joints alone to "
    "compare with. F_M of MLS36 is 0 whatever the noise: 36 equations determine 36 unknowns. The floor of "
    "the others spreads their 15 spare equations evenly, 2 sqrt(3 (1 - 21/36)) = 2.24. Under axis loads 3 "
    "of them are in positions and 12 in rotations: sqrt(3) (sqrt(3/18) + sqrt(12/18)) = 2.12."
)
OF_MATRICES = Markdown(
    "Rows and columns of a matrix are x, y, z, phi_x, phi_y, phi_z, in m/N, rad/N and rad/(N m); "
    "eigenvalues stand in ascending order, in these mixed units as the paper's. The readings of this seed "
    "are in dataset.csv."
)
PICTURES = Markdown(
    "**Pictures** Entry ij over the root of the true entries ii and jj, signed log, one range of colours, "
    "first draw. Grey: 0. Brown: as large as a true diagonal. Yellow: ten times as large. Blue to cyan: "
    "negative. **Blue on a diagonal gives energy away**, here in the corner x, where the truth is "
    "stiffest.\n\n**Scrub** `sweep` is the order m of the vector space, Eq. 20 (tab Order m)."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every method and order; truth values as shares of the draws."""
    cell = build_cell(find_arm(NAME))
    first = measure(cell, asked, seeds[0])
    f = Row(
        seed=seeds[0],
        draws=len(seeds),
        arm=asked.campaign.arm,
        truth=asked.campaign.truth,
        noise=asked.campaign.noise,
        noise_per="deflection",
        loads=asked.loads,
        dataset=_dataset(asked, first),
        truth_matrix=cell.arm.C_theta.tolist(),
        units="matrices: m/N, 1/N, rad/(N m); eigenvalues in these mixed units, as the paper's",
        order_range=order_range(models(cell)[-1].structure, first.identification.runs),
        eq_22_23=printed.printed_matrices(cell, asked, first.truth),
        rule=paper.RULE,
    )
    known = _printed(cell, first, f.eq_22_23)
    solved, searched = trials.where(m=0), trials.pick(trials["m"] > 0)
    f |= _found(cell, solved, known) | {
        "order_draws": len(searched.values("seed")),
        "order": [_order(own) for _, own in searched.groups("m")],
    }
    f |= {"worst": _worst_entry(f), "which_m": _which_m(f)}
    f |= {"claims": list(_judged(f))}
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
            "paired": _wins(f),
            "claims": Table(columns("claim verdict why"), f.claims, "The paper's statements"),
            "order": Table(columns(ORDER, paper=False), f.order, "The order m, Eq. (20)"),
            "printed": printed.table(f.eq_22_23),
            "own": Table(columns(OWN), f.eq_22_23[printed.OWN].order, "The order m on the paper's own data"),
            "matrices": _entries(f),
        },
        body=[
            *("shape", OF_SHAPE, "errors", _of_errors(f), "paired", "claims", Markdown(paper.RULE), "order"),
            *("printed", "own", "matrices", OF_MATRICES),
        ],
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


def _printed(cell: Cell, draw: Draw, found: Row) -> dict[str, Row]:
    """The printed matrices judged as ours are; whether Eq. (23) is negative lies below its printed digits."""
    ls, ours = (Row(vars(judge(cell, np.array(C), draw.truth))) for C in (paper.EQ_22, paper.EQ_23))
    unknown = {"negative_eigenvalue": None, "negative_eigenvalue_matrix": None}
    return {
        LEAST_SQUARES: Row(ls, conservative=ls.symmetric, f_m=0.0),
        GCO: Row(ours | unknown, conservative=ours.symmetric, f_m=found[printed.OWN].printed_f_m),
    }


def _found(cell: Cell, trials: Trials, known: dict[str, Row]) -> Row:
    """Every method over all draws, and GCO beside the others in the same draws."""
    every = [_model(cell, own, known.get(name)) for (name,), own in trials.groups("name")]
    first = {name: np.reshape(own["C"][0], (6, 6)) for (name,), own in trials.groups("name")}
    better = {
        other: {_last(key): wins(*aligned(trials, (GCO, other), key).T) for key in QUANTITIES}
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
        first_draw=Row({name: printed.with_eigenvalues(C) for name, C in first.items()}),
    )


def _model(cell: Cell, trials: Trials, known: Row | None) -> Row:
    [m] = merged(trials.drop("seed", "m", "condition", "C", "eigenvalues", *OF_AN_ORDER))
    error = np.array(trials["C"].tolist()).reshape(-1, 6, 6) - cell.arm.C_theta
    return Row(
        m | {key: float(m[key]) for key in SHARES},
        rank_of_C=_counts(trials["rank_of_C"]),
        entry_rms=np.sqrt((error**2).mean(axis=0)).tolist(),
        entry_bias=error.mean(axis=0).tolist(),
        min_eigenvalues_micro=trials["matrix_eigenvalue_micro"].tolist(),
        paper=known,
    )


OF_AN_ORDER = ("f_m_over_optimum", "excess_percent", "reaches_optimum")


def _order(trials: Trials) -> Row:
    kept = ("m", "name", "f_m", *OF_AN_ORDER, "conservative", "eigenvalues", "prediction.")
    [row] = merged(trials.keep(*kept))
    shares = {key: float(row[key]) for key in ("reaches_optimum", "conservative")}
    return Row(row | shares, rank_of_C=_counts(trials["rank_of_C"]))


def _counts(ranks: Cells) -> dict[str, int]:
    """Draws by rank of C."""
    return {str(rank): int(count) for rank, count in zip(*np.unique(ranks, return_counts=True), strict=True)}


def _named(f: Row) -> Row:
    """The methods by what they are called in words."""
    called = {LEAST_SQUARES: "ls", SYMMETRIC: "symmetric", GCO: "ours"}
    return Row({called[m.name]: m for m in f.models})


def _worst_entry(f: Row) -> Row:
    """The entry on the diagonal of C that GCO finds worst, over its true value; RMS errors in the unit."""
    by = _named(f)
    true, gco, theirs = (np.diag(C) for C in (f.truth_matrix, by.ours.entry_rms, by.ls.entry_rms))
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
    symmetric = _named(f).symmetric
    yield say(
        "Least squares of a symmetric matrix (MLS21) errs {prediction.position_rms_um:~.1f} um: "
        "{gain:more draw}.",
        symmetric,
        gain=f.gains.symmetric,
    )
    if symmetric.unique is True:
        yield say(
            "The loads determine all {parameters} entries: here the constraint makes the matrix "
            "conservative, not the choice among equal fits.",
            symmetric,
        )
    yield f.which_m
    yield say(
        "Of {n} statements, the paper's and ours, {held} are confirmed; their table says why the others "
        "are not.",
        n=len(f.claims),
        held=sum(own.verdict == "confirmed" for own in f.claims),
    )
    yield say("Least position error: {best_position:list}. Least rotation error: {best_rotation:list}.", f)
    if f.loads == "random":
        yield say(
            "The random loads have a condition number of {condition_of_the_loads:.1f}, axis loads of 1. "
            "Directions that are rarely loaded are read with that much more noise.",
            f,
        )


def _of_errors(f: Row) -> Markdown:
    true, by = f.truth_matrix[0][0], _named(f)
    return say(
        "Errors of predictions are RMS distances from the true deflection, without the noise of readings, "
        "which would add {noise:.0f} um in quadrature. The loads are fresh, spread evenly over |F| <= 10 N "
        "and |M| <= 10 N m. Errors of C are RMS over the nine entries of a block. In square brackets: the "
        "printed matrices under the check loads of our first draw. GCO pays with a bias where the truth is "
        "near zero: it cannot find c11 = {true:.3f} um/N below zero. It finds {ours:.2f} um/N in the mean, "
        "least squares {ls:.2f}.",
        noise=f.dataset.sigma_of_a_deflection_um * math.sqrt(3),
        true=UM * true,
        ours=UM * (true + by.ours.entry_bias[0][0]),
        ls=UM * (true + by.ls.entry_bias[0][0]),
    )


def _judged(f: Row) -> Iterator[paper.Claim]:
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
    own = f.eq_22_23[printed.OWN]
    least, most = own.printed_f_m_within_rounding
    yield paper.judged(
        "Eq. (23) has the least F_M of a conservative matrix",
        least <= own.optimum_f_m + (own.optimum_f_m_excess_bound or 0.0),
        f"F_M is {own.printed_f_m:.3f}, {least:.2f} to {most:.2f} within its rounding; the certified "
        f"optimum of the paper's own data has {own.optimum_f_m:.3f}",
    )
    low, high = f.order_range
    failing = [f"m = {row.m}" for row in f.order if row.m >= low and row.m not in _sure(f)]
    yield paper.judged(
        f"any order m that Eq. (20) allows, {low:g} to {high:g}, will do",
        not failing,
        f"not in every draw at the optimum: {', '.join(failing) or 'none'}",
    )


def _wins(f: Row) -> Table:
    """In how many draws GCO is closer to the truth, by quantity."""
    rows = [
        Row(
            name=column.heading,
            **{other: own.gco_better[_last(column.key)] for other, own in f.paired.items()},
        )
        for column in columns(" ".join(QUANTITIES))
    ]
    name = Column("name", f"draws in which {GCO} is closer to the truth")
    return Table((name, *(Column(other, f"than {other}", form="d") for other in OTHERS)), rows)


def _matrices(f: Row) -> dict[str, Row]:
    """The truth, the first draw, and what the paper prints, by title."""
    return {
        "truth, Eq. (21)": printed.with_eigenvalues(np.array(f.truth_matrix)),
        **{f"{name}, first draw": C for name, C in f.first_draw.items()},
        "LS, Eq. (22)": f.eq_22_23.eq_22,
        "GCO, Eq. (23)": f.eq_22_23.eq_23,
        "optimum of the paper's data": f.eq_22_23[printed.OWN].optimum,
    }


def _entries(f: Row) -> Table:
    """Every matrix row by row, then its eigenvalues; those of every order m."""
    rows = []
    for name, C in _matrices(f).items():
        rows += [(f"{name}: {axis}", own) for axis, own in zip(AXES, C.matrix, strict=True)]
        rows.append((f"{name}: eigenvalues", C.eigenvalues_matrix))
        if not np.array_equal(C.matrix, np.transpose(C.matrix)):
            rows.append((f"{name}: eigenvalues of the symmetric part", C.eigenvalues_symmetric_part))
    rows += [
        (f"m = {row.m}: eigenvalues, median of {f.order_draws} draws", row.eigenvalues) for row in f.order
    ]
    heads = [Column(f"own.{k}", axis, SI, ".3f", exact=True, scale=UM) for k, axis in enumerate(AXES)]
    found = [Row(name=name, own=own) for name, own in rows]
    return Table(
        (Column("name", "matrix and row"), *heads), found, f"Matrices of seed {f.seed}, and the paper's"
    )


def figures(found: Report) -> dict[str, Figure]:
    """Smallest eigenvalues over the draws, and what the order m costs."""
    f = Row(found.numbers)
    by = _named(f)
    return {"single_link.png": single_link(f, by.ls, by.ours)}


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first draw."""
    draw = measure(build_cell(find_arm(NAME)), run.settings, run.seeds[0])
    write_csv(draw.identification, (), run.folder / "dataset.csv")


def _last(key: str) -> str:
    return key.rpartition(".")[2]
