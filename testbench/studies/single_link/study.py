"""Section 5.1: one link, least squares with 36 free entries against GCO."""

import math
from collections.abc import Iterator

import numpy as np

from testbench.arm.folder import find_arm, load_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.rows import UM
from testbench.report import campaigns
from testbench.report.badge import of_rivals
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials, aligned, merged, nested
from testbench.studies import paper
from testbench.studies.estimators.factorised import order_range
from testbench.studies.single_link import trial
from testbench.studies.single_link.trial import GCO, LEAST_SQUARES, NAME, SYMMETRIC, Settings, models
from testbench.studies.study import Study
from testbench.trials.spread import middle, span, wins
from testbench.views.figure import Figure, forest
from testbench.views.gains import beside, ratio
from testbench.views.markdown import Markdown, counted
from testbench.views.schema import Table, show_truth

POSITION, ROTATION, ENTRY = "position_rms_um", "rotation_rms_urad", "force_position_rms_um_per_N"
SHARES = ("conservative", "symmetric", "negative_eigenvalue", "negative_eigenvalue_matrix", "reaches_optimum")
"""Truth values that a report gives as shares of the draws."""
OF_A_DRAW = ("seed", "measured.", "condition", "error", "printed.", "data_file")
SHAPE = (
    "name conservative symmetric negative_eigenvalue_matrix negative_eigenvalue matrix_eigenvalue_micro "
    "symmetric_eigenvalue_micro f_m f_m_floor"
)
ERRORS = (
    f"name {POSITION} position_relative_percent {ROTATION} rotation_relative_percent {ENTRY} "
    "moment_position_rms_um_per_Nm force_rotation_rms_urad_per_N moment_rotation_rms_urad_per_Nm"
)
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
    f = Row(_found(asked, trials), seed=seeds[0], draws=len(seeds))
    f |= {"which_m": _which_m(f), "claims": list(_judged(f))}
    return Report(
        scenario=NAME,
        question=Markdown(
            "Single link, section 5.1: is a conservative compliance nearer the truth than least squares?"
        ),
        title=_title(f),
        answer=say(
            "Position error: GCO {ours.position_rms_um:~.1f} um, least squares {ls.position_rms_um:~.1f} um; "
            "{gain:less draw}. Of {draws} draws GCO is conservative in {ours.conservative:yes}, least "
            "squares in {ls.conservative:yes}, with a symmetric matrix in "
            "{symmetric.conservative:share {draws}}.",
            _named(f),
            gain=f.gains.least_squares,
            draws=f.draws,
        ),
        worst=say(
            "Worst entry is {name}, {true:.3f} {unit}: GCO errs {gco:.3f} {unit} RMS, least squares "
            "{least_squares:.3f}.",
            f.worst,
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "shape": Table(
                columns(SHAPE), f.models, "What kind of matrix", headline="symmetric_eigenvalue_micro"
            ),
            "errors": Table(columns(ERRORS), f.models, "How far off", headline=POSITION),
            "claims": Table(columns("claim verdict why"), f.claims, "The paper's statements"),
            "order": Table(columns(ORDER, paper=False), f.order, "The order m, Eq. (20)"),
        },
        body=["shape", OF_SHAPE, "errors", _of_errors(f), "claims", Markdown(paper.RULE), "order"],
        badge=of_rivals(trials.where(m=0), GCO, [*OTHERS], POSITION),
    )


def _found(asked: Settings, trials: Trials) -> Row:
    """Every method over all draws, GCO beside the others in the same draws, and the order m."""
    plain, searched, campaign = trials.where(m=0), trials.pick(trials["m"] > 0), asked.campaign
    um, urad = UM * campaign.sigma, UM * campaign.sigma_rotation
    data, [loads] = campaigns.dataset(plain), merged(plain.where(name=GCO).keep("condition"))
    found = [_merged(own, **_entries(own)) for _, own in plain.groups("name")]
    duels = {"least_squares": (GCO, LEAST_SQUARES), "symmetric": (GCO, SYMMETRIC)}
    return Row(
        arm=campaign.arm,
        truth=campaign.truth,
        noise=campaign.noise,
        noise_per="deflection",
        loads=asked.loads,
        condition_of_the_loads=loads.condition,
        dataset=Row(
            data,
            check_runs=campaign.check_runs,
            sigma_urad=urad,
            sigma_of_a_deflection_um=math.sqrt(2) * um,
            sigma_of_a_deflection_urad=math.sqrt(2) * urad,
        ),
        order_range=order_range(models(build_cell(find_arm(NAME)))[-1].structure, data.runs),
        rule=paper.RULE,
        models=found,
        gains=campaigns.pairs(plain, duels, POSITION, 1e-3),
        paired={
            other: {key: wins(*aligned(plain, (GCO, other), key).T) for key in (POSITION, ROTATION)}
            for other in OTHERS
        },
        lost={other: wins(*aligned(plain, (other, GCO), POSITION).T) for other in OTHERS},
        worst=_worst_entry(found),
        order_draws=len(searched.values("seed")),
        order=[_merged(own) for _, own in searched.groups("m")],
    )


def _merged(own: Trials, **more: object) -> Row:
    [row] = merged(own.drop(*OF_A_DRAW))
    return Row(row, **{key: float(row[key]) for key in SHARES}, **more)


def _entries(own: Trials) -> dict[str, object]:
    """Errors of the entries of C over all draws, and what the paper's printed matrix has."""
    error = np.array(own["error"].tolist()).reshape(-1, 6, 6)
    name, first = str(own["name"][0]), own.inside("printed")
    known = nested({key: cells[0] for key, cells in first.columns.items()}) if name in trial.PRINTED else None
    if known:
        known |= {"conservative": known.symmetric}
        # F_M of least squares is 0; the sign of an eigenvalue of Eq. (23) lies below its printed digits
        signs = {"negative_eigenvalue": None, "negative_eigenvalue_matrix": None}
        known |= {"f_m": 0.0} if name == LEAST_SQUARES else signs
    rms, bias = np.sqrt((error**2).mean(axis=0)), error.mean(axis=0)
    return {"entry_rms": rms.tolist(), "entry_bias": bias.tolist(), "paper": known}


def _named(f: Row) -> Row:
    """The methods by what they are called in words."""
    by = {m.name: m for m in f.models}
    return Row(ls=by[LEAST_SQUARES], symmetric=by[SYMMETRIC], ours=by[GCO])


def _worst_entry(found: list[Row]) -> Row:
    """The entry on the diagonal of C that GCO finds worst, over its true value; RMS errors in the unit."""
    by = _named(Row(models=found))
    true, gco, theirs = (
        np.diag(C) for C in (load_arm(find_arm(NAME)).C_theta, by.ours.entry_rms, by.ls.entry_rms)
    )
    k = int(np.argmax(gco / true))
    sizes = {"true": true, "gco": gco, "least_squares": theirs}
    own = {key: UM * float(size[k]) for key, size in sizes.items()}
    return Row(own, name=f"c{k + 1}{k + 1}", unit="um/N" if k < HALF else "urad/(N m)")


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


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield say(
        "Least squares of a symmetric matrix (MLS21) errs {position_rms_um:~.1f} um: {gain:more draw}.",
        _named(f).symmetric,
        gain=f.gains.symmetric,
    )
    yield say(
        "GCO is nearer the truth than MLS21 in {position_rms_um} of {draws} draws in position, in "
        "{rotation_rms_urad} in rotation; nearer than MLS36 in {ls.position_rms_um} and "
        "{ls.rotation_rms_urad}.",
        f.paired[SYMMETRIC],
        ls=Row(f.paired[LEAST_SQUARES]),
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
        won, test = f.paired[other][POSITION], "its position error is the smaller one"
        row = paper.comparison(f"GCO predicts better than {words}", test, won, f.lost[other], f.draws)
        gain = f.gains.symmetric if other == SYMMETRIC else f.gains.least_squares
        yield Row(row, why=f"{row.why}; median ratio of the errors {ratio(middle(gain.times))}")
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
        f"Section 5.1, {loads} loads, a draw each. Grey "
        "diamonds: the paper's printed matrices. Dotted line: least squares with a symmetric matrix."
    )
    panes = {POSITION: "position", ROTATION: "rotation", ENTRY: "entries of C, force to position"}
    return {"single_link.png": forest(found.tables["errors"], panes, answer, reading, SYMMETRIC)}


STUDY = Study(
    name=NAME,
    about="Identify the single link of section 5.1 by least squares and by GCO, over many draws of noise.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1000, 100),
    arms=lambda _: [find_arm(NAME)],
    row=trial.LinkRow,
    trials=trial.trials,
    report=report,
    printed=("errors", "shape"),
    figures=figures,
    size=10,
)
