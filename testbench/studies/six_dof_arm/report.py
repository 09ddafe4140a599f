"""What the trials say: Tables I and II under both truths, the order m, and the paper's statements judged."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import EQUAL_FIT, JOINTS
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import simulate
from testbench.bench.judged import identify
from testbench.data.csvfile import write_csv
from testbench.report import campaigns
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials, aligned, merged, number, paired
from testbench.studies import paper
from testbench.studies.paper import SECTION_5_2
from testbench.studies.six_dof_arm.trial import CLOSE, MODELS, ORDER_MODELS, ORDERED, TRUTHS, Settings, models
from testbench.studies.study import Run
from testbench.trials.spread import middle, span, wins
from testbench.views.figure import Figure, curves, forest, of_seeds
from testbench.views.gains import beside
from testbench.views.map_figure import error_map
from testbench.views.markdown import Markdown, counted, listed
from testbench.views.page.page import Seen
from testbench.views.schema import Table, best_of, show_truth

ERROR = "check_true.p95_mm"  #: What models are judged by.
SAME = 1.02  #: An order m serves as well as 6 where F_M and the check error exceed those of m = 6 by less.
EQUAL = 1e-7  #: Share of F_M by which GCO may exceed least squares and still fit as well.
NOT_OF_A_MODEL = ("seed", "truth", "measured.", "places.", "place_mm")
SHORT = f"name conservative check.p95_mm {ERROR} check.max_relative_percent times_less"
TABLE_II = (
    f"name parameters rank conservative f_m f_m_floor check.p95_mm {ERROR} check.rms_mm check_true.rms_mm "
    "check.p95_relative_percent check.max_relative_percent check_true.max_relative_percent times_less"
)
ORDER = f"name m f_m f_m_over_optimum block_rank min_scaled_eigenvalue {ERROR}"
TIES = "truth seeds free also_conservative fits_as_well"
CELLS = columns("check.p95_mm check.max_relative_percent")  #: Of Table II, that the paper's text gives.
PANES = {
    ERROR: "linear truth, as in the paper",
    "check.p95_mm": "the same, against readings",
    f"nonlinear.{ERROR}": "MuJoCo's non-linear truth",
}
COMPARED = (
    ("MGCO56 is the best model", "mgco56_best", "its 95 % error without noise is the least of the five"),
    (
        "MGCO56 and MLS32 are nearly the same",
        "mgco56_near_mls32",
        f"their 95 % errors without noise differ by at most {100 * CLOSE:g} %",
    ),
    (
        "MLS56 does worse than MLS32",
        "mls32_better_than_mls56",
        "the 95 % error without noise of MLS32 is the smaller one",
    ),
    (
        "a linear model is enough (the paper's truth is linear)",
        "linear_is_enough",
        f"MGCO56's 95 % error without noise grows by at most {100 * CLOSE:g} % with the non-linear truth",
    ),
)
"""Statements that compare two errors on the same data, what of `paired` counts it, and what is counted."""
READING = Markdown(
    "The paper's number stands in square brackets where its text gives it. Errors of *readings* include "
    "their noise, as we take the paper's to do; *true* are errors of the same runs without noise. Joints: "
    "joint stiffness only, links rigid, plain least squares. PSD of equal fit: of all solutions that fit as "
    "MLS56 does the conservative one nearest to it; where there is none it is MLS56."
)
OF_TIES = Markdown(
    "MLS56 has more unknowns than the data see; minimum norm fills the rest with a matrix that is not "
    "conservative. We count the seeds in which the same fit has a conservative solution too, and those in "
    "which GCO fits as well to a ten-millionth of F_M. Both solutions predict the same. Only in the other "
    "seeds does the constraint change the fit."
)
OF_CLAIMS = Markdown(
    f"{paper.RULE} Where one of the paper's numbers lies outside, we cannot tell two reasons apart: it is of "
    "one draw of noise and check runs, and of an arm whose dimensions stand in a reference that we do not "
    "have."
)
OF_ORDER = Markdown(
    "Linear truth, the best of several local solves; the optimum is that of the conic program. The template "
    "of MGCO56 splits a link into blocks of size 1 and 2, so m = 2 already reaches all of it."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every model and order, pairs of models, verdicts."""
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=asked.scenario.arm,
        noise=asked.scenario.noise,
        noise_per=asked.per,
        truth="linear",
        **_found(trials),
        rule=paper.RULE,
    )
    f |= {"which_m": _which_m(f), "claims": list(_judged(f))}
    straight, bent = "Linear truth, as in the paper", "MuJoCo's non-linear truth, own weight included"
    short, whole = columns(SHORT, paper=False), columns(TABLE_II)
    return Report(
        scenario="six_dof_arm",
        question=say("{arm} under any load: which stiffness model predicts its deflection best?", f),
        title=_title(f),
        answer=say(
            "True error of 95 % in the check runs: {a.ours} {a.ours_mm:~.3f} mm, least squares "
            "{a.theirs_mm:~.3f} mm; {a:less seed}. Joints alone {b.theirs_mm:~.3f} mm, {b:more}.",
            a=f.gains.least_squares,
            b=f.gains.joints,
        ),
        worst=_worst(f),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "short": Table(short, f.models, straight, f.take, headline=ERROR),
            "short_nonlinear": Table(short, f.nonlinear.models, bent, headline=ERROR),
            "linear": Table(whole, f.models, straight, f.take),
            "nonlinear": Table(whole, f.nonlinear.models, bent),
            "ties": Table(columns(TIES), f.ties, "Conservative: constraint or tie-break?"),
            "claims": Table(columns("claim verdict why"), f.claims, "The paper's statements"),
            "order": Table(columns(ORDER), [*f.order.MGCO69, *f.order.MGCO56], "The order m, Eq. (20)"),
        },
        body=["linear", READING, "nonlinear", "ties", OF_TIES, "claims", OF_CLAIMS, "order", OF_ORDER],
    )


def _found(trials: Trials) -> Row:
    """Every number that is made of the trials."""
    fits, searched = trials.where(m=0).drop("m", *ORDERED), trials.pick(trials["m"] > 0)
    straight, bent = (fits.where(truth=truth) for truth in TRUTHS)
    models, others = (merged(own.drop(*NOT_OF_A_MODEL), "name") for own in (straight, bent))
    least_squares, gco = (
        _best([m for m in models if m.constraint == constraint and m.structure != JOINTS])[0]
        for constraint in ("none", "psd")
    )
    for m, own in [*((m, straight) for m in models), *((m, bent) for m in others)]:
        gain = paired(own, m.name, least_squares, ERROR)
        known = SECTION_5_2.get(m.name) if own is straight else None
        m |= {"times_less": gain and gain.times, "paper": known}
    orders = merged(searched.drop(*NOT_OF_A_MODEL), "name", "m")
    by_model = {name: [row for row in orders if row.name == name] for name in ORDER_MODELS}
    best = _best(models)
    return Row(
        dataset=_measured(straight),
        models=models,
        nonlinear=Row(dataset=_measured(bent), models=others),
        order=Row(seeds=searched.values("seed"), **by_model),
        enough=[Row(model=name, m=_enough(rows)) for name, rows in by_model.items()],
        paired=_paired(straight, bent),
        ties=[_tie(straight), _tie(bent)],
        best=best,
        take=gco if gco in best else best[0],
        gains=Row(
            least_squares=paired(straight, gco, least_squares, ERROR),
            joints=paired(straight, gco, JOINTS, ERROR),
            nonlinear=paired(bent, gco, least_squares, ERROR),
            nonlinear_joints=paired(bent, gco, JOINTS, ERROR),
        ),
        map=campaigns.error_map(straight, (least_squares, gco)),
    )


def _measured(trials: Trials) -> Row:
    [data] = merged(trials.where(name="MLS56").keep("measured."))
    return Row(data.measured)


def _best(rows: Sequence[Row]) -> list[str]:
    """The models of least error; not the completed one, whose fit and predictions are those of MLS56."""
    errors = {m.name: m.check_true.p95_mm for m in rows if m.name != EQUAL_FIT}
    return list(best_of(errors, CLOSE).names)


def _paired(straight: Trials, bent: Trials) -> Row:
    """On the same data, by errors without noise: in how many seeds."""
    errors = dict(zip((*MODELS, JOINTS), aligned(straight, (*MODELS, JOINTS), ERROR).T, strict=True))
    ours, mls32 = errors["MGCO56"], errors["MLS32"]
    others = np.min([errors[name] for name in MODELS if name != "MGCO56"], axis=0)
    return Row(
        seeds=len(ours),
        mgco56_best=wins(ours, others),
        mgco56_better_than_mls32=wins(ours, mls32),
        mgco56_near_mls32=int((np.abs(ours / mls32 - 1) <= CLOSE).sum()),
        mls32_better_than_mls56=wins(mls32, errors["MLS56"]),
        mgco56_better_than_joints=wins(ours, errors[JOINTS]),
        linear_is_enough=int((aligned(bent, ("MGCO56",), ERROR)[:, 0] <= (1 + CLOSE) * ours).sum()),
        mgco56_over_mls32_p95_check_true=number(ours / mls32),
        joints_over_mgco56_p95_check_true=number(errors[JOINTS] / ours),
    )


def _tie(trials: Trials) -> Row:
    """In how many seeds MLS56 is not conservative only because it takes another of several equal fits."""
    mls56 = trials.where(name="MLS56")
    f_m, ours = aligned(trials, ("MLS56", "MGCO56"), "f_m").T
    return Row(
        truth=str(trials["truth"][0]),
        seeds=len(f_m),
        free=int(mls56["parameters"][0] - mls56["rank"][0]),
        also_conservative=int(trials.where(name=EQUAL_FIT)["conservative"].sum()),
        fits_as_well=int((ours <= (1 + EQUAL) * f_m).sum()),
    )


def _enough(rows: Sequence[Row]) -> int:
    """The least order m that costs less than `SAME` in F_M and check error."""

    def sizes(row: Row) -> tuple[float, float]:
        return middle(row.f_m), middle(row.check_true.p95_mm)

    f_m, error = sizes(rows[-1])
    return next(int(r.m) for r in rows if sizes(r)[0] <= SAME * f_m and sizes(r)[1] <= SAME * error)


def _which_m(f: Row) -> Markdown:
    least = listed([f"m = {own.m} on for {own.model}" for own in f.enough])
    return say("Order m: 6 always serves. F_M and check error are as good from {least}.", least=least)


def _title(f: Row) -> Markdown:
    """What was measured."""
    seeds = "{n} seeds: median ({ends})" if isinstance(f.seed, list) else "seed {seed}"
    return say(
        f"{{arm}}: {{dataset.runs}} runs in {{dataset.poses}} poses under single-axis loads, full pose read "
        f"with {{dataset.sigma_um:.3g}} um and {{dataset.sigma_urad:.3g}} urad a reading; "
        f"{{dataset.check_runs}} check runs, deflections {{dataset.deflection_min_mm:.1f}} to "
        f"{{dataset.deflection_max_mm:.1f}} mm; {seeds}",
        f,
        n=len(f.seed) if isinstance(f.seed, list) else 1,
        ends=span(len(f.seed)) if isinstance(f.seed, list) else "",
    )


def _worst(f: Row) -> Markdown:
    """With the non-linear truth, and where with the linear one."""
    at = f.map.worst[f.gains.least_squares.ours]
    return say(
        "Worst with non-linear truth: {a.ours} {a.ours_mm:~.3f} mm, least squares {a.theirs_mm:~.3f} mm, "
        "joints alone {b.theirs_mm:~.3f} mm. With linear truth{seed} at {at.position_m:place}: "
        "{at.error_mm:.3f} mm, least squares {rival:.3f} mm.",
        a=f.gains.nonlinear,
        b=f.gains.nonlinear_joints,
        seed=f" in seed {f.seed[0]}" if isinstance(f.seed, list) else "",
        at=at,
        rival=f.map.error_mm[f.gains.least_squares.theirs][at.place],
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    tie, bent = f.ties
    yield say(
        "GCO is conservative, minimum norm least squares is not. Another solution of its fit is, in "
        "{also_conservative} of {seeds} seeds with linear truth, in {bent} with the other: partly a "
        "tie-break.",
        tie,
        bent=bent.also_conservative,
    )
    yield say(
        "Against noisy readings {name} errs {check.p95_mm:~.3f} mm, noise alone {noise:.3f} mm: readings "
        "tell these models apart badly. Compare the true errors.",
        next(m for m in f.models if m.name == f.gains.joints.ours),
        noise=f.dataset.noise_p95_mm,
    )
    yield say(
        "This arm bends almost only in its links, as the paper's does: MGCO56 is better than joints alone in "
        "{mgco56_better_than_joints} of {seeds} seeds.",
        f.paired,
    )
    yield say(
        "Of the paper's {n} statements {held} are confirmed; their table says why the others are not.",
        n=len(f.claims),
        held=sum(own.verdict == "confirmed" for own in f.claims),
    )
    yield f.which_m
    if len(f.best) > 1:
        rest = ", less than the rest" if len(f.best) < len(f.models) else ""
        yield say(f"{{best:list}} err alike{rest}.", f)


def _judged(f: Row) -> Iterator[paper.Claim]:
    """The paper's statements of section 5.2, and what our numbers say of each."""
    own, tie = {m.name: m for m in f.models}, f.ties[0]
    ours = [own[name] for name in MODELS]
    shares = ", ".join(f"{m.name}: {show_truth(m.conservative)}" for m in ours)
    yield paper.judged(
        "only the GCO models are conservative (Table I)",
        all(m.conservative is (m.constraint == "psd") for m in ours),
        f"{shares}. For MLS56 that is a tie-break: it takes the minimum norm in {tie.free} free directions; "
        f"another solution of the same fit is conservative in {tie.also_conservative} of {tie.seeds} seeds",
    )
    for name in ("MGCO56", "MLS32", "MLS56", "MGCO69", "MGCO147"):
        yield from _cells(own[name])
    for claim, key, test in COMPARED:
        yield paper.comparison(claim, test, f.paired[key], f.paired.seeds)


def _cells(m: Row) -> Iterator[paper.Claim]:
    """The cells of Table II that the paper's text gives of a model."""
    differs = "another arm and a single draw"
    if m.name == "MGCO69":
        differs += "; links 1, 4, 5 and 6, which MGCO69 takes for rigid, weigh differently on ours"
    for column in CELLS:
        if known := column.known_value(m):
            words = "mm, 95 %" if column.unit == "mm" else "% at most"
            yield paper.number(f"{m.name}: {known:g} {words}", column.value(m), known, differs)


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model, of every order m, and where the best of each method err."""
    f = Row(found.numbers)
    bent = {m.name: m for m in f.nonlinear.models}
    rows = [Row(m, nonlinear=bent[m.name]) for m in f.models]
    drawn = (*columns(f"name {ERROR} check.p95_mm"), replace(KNOWN[ERROR], key=f"nonlinear.{ERROR}"))
    gains = {"least squares": f.gains.least_squares, "joints alone": f.gains.joints}
    reading = (
        f"Errors of 95 % of the check runs. {of_seeds(f.seed)}. Dotted: joints alone; diamonds: the paper's."
    )
    answer = f"{f.arm}, section 5.2, true error of 95 % in the check runs: {beside(gains)}"
    orders = {"f_m_over_optimum": "F_M", ERROR: "error of 95 % in the check runs, true"}
    tried = f"Medians of {counted(len(f.order.seeds), 'seed')}."
    return {
        "six_dof_arm.png": forest(Table(drawn, rows), PANES, answer, reading, JOINTS),
        "order.png": curves(found.tables["order"], orders, f.which_m, tried),
        "error_map.png": error_map(f.map, f"{f.arm}, check runs under linear truth", f.seed),
    }


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed, linear truth; what is drawn of it."""
    cell = build_cell(find_arm(run.settings.arm))
    campaign = simulate(cell, run.settings.scenario, run.seeds[0])
    write_csv(campaign.identification, cell.arm, run.folder / "dataset.csv")
    results = identify(cell, campaign, models(cell), time.perf_counter)
    return campaigns.draw(run.report, (cell, campaign, results), run.settings.magnification)
