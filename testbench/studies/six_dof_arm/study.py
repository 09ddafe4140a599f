"""Section 5.2: the illustrative 6R arm, full poses under single-axis loads, LS against GCO, the order m."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtri

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.models import EQUAL_FIT, JOINTS
from testbench.campaign.rows import MM, UM
from testbench.report import badge, campaigns
from testbench.report.campaigns import NOT_OF_A_MODEL
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import Row, Trials, aligned, merged
from testbench.studies import paper
from testbench.studies.calibration_scene import calibration_scene, write_runs
from testbench.studies.paper import SECTION_5_2
from testbench.studies.six_dof_arm import trial
from testbench.studies.six_dof_arm.trial import CLOSE, MODELS, ORDER_MODELS, TRUTHS, Settings
from testbench.studies.study import Run, Study
from testbench.trials.spread import middle, wins
from testbench.views.figure import Figure, forest
from testbench.views.markdown import Markdown, listed
from testbench.views.scene import Seen
from testbench.views.schema import Table, best_of, show_truth

ERROR = "check_true.p95_mm"  #: What models are judged by.
BENT = f"nonlinear.{ERROR}"
SAME = 1.02  #: An order m serves as well as 6 where F_M and the check error exceed those of m = 6 by less.
EQUAL = 1e-7  #: Share of F_M by which GCO may exceed least squares and still fit as well.
SHORT = f"name conservative check.p95_mm {ERROR} {BENT}"
TABLE_II = (
    f"name parameters rank conservative f_m f_m_floor check.p95_mm {ERROR} {BENT} "
    "check.max_relative_percent check_true.max_relative_percent times_less"
)
ORDER = f"name m f_m f_m_over_optimum {ERROR}"
CELLS = columns("check.p95_mm check.max_relative_percent")  #: Of Table II, that the paper's text gives.
PANES = {
    ERROR: "linear truth, as in the paper",
    "check.p95_mm": "the same, against readings",
    BENT: "MuJoCo's non-linear truth",
}
COMPARED = (
    ("MGCO56 is the best model", "mgco56_best", "its 95 % error without noise is the smallest of the five"),
    (
        "MLS56 does worse than MLS32",
        "mls32_better_than_mls56",
        "the 95 % error without noise of MLS32 is the smaller one",
    ),
)
"""Statements that one error is smaller than others on the same data, what of `paired` counts it, and what."""
NEAR = (
    (
        "MGCO56 and MLS32 are nearly the same",
        "mgco56_near_mls32",
        f"their 95 % errors without noise differ by at most {100 * CLOSE:g} %",
    ),
    (
        "a linear model is enough (the paper's truth is linear)",
        "linear_is_enough",
        f"MGCO56's 95 % error without noise grows by at most {100 * CLOSE:g} % with the non-linear truth",
    ),
)
"""Statements that two errors are nearly the same, in the same form."""
READING = Markdown(
    "The paper's number stands in square brackets where its text gives it. The truth is linear, as in the "
    "paper, but in the column of MuJoCo's, own weight included. Errors of *readings* include their "
    "noise, as we take the paper's to do; *true* are errors of the same runs without noise. Joints: joint "
    "stiffness only, links rigid, plain least squares. PSD of equal fit: of all solutions that fit as MLS56 "
    "does the conservative one nearest to it; where there is none it is MLS56."
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
        seed=campaigns.seeds_of(seeds),
        arm=asked.scenario.arm,
        noise=asked.scenario.noise,
        noise_per=asked.per,
        truth="linear",
        **_found(asked, trials),
        rule=paper.RULE,
    )
    f |= {"which_m": _which_m(f), "claims": list(_judged(f))}
    straight = trials.where(m=0, truth=TRUTHS[0])
    own = badge.of_models(straight, f.models, f.take, ERROR)
    f["map"] = campaigns.error_map(
        straight, badge.drawn(own, straight["name"], *campaigns.own(f.models), f.gains.least_squares.theirs)
    )
    return Report(
        scenario=STUDY.name,
        question=say("{arm} under any load: which stiffness model predicts its deflection best?", f),
        title=say(
            "{arm}: {dataset.runs} runs in {dataset.poses} poses under single-axis loads, full pose read "
            "with {dataset.sigma_um:.3g} um and {dataset.sigma_urad:.3g} urad a reading; "
            "{dataset.check_runs} check runs, deflected within {least:g} and {most:g} mm; {seeds}",
            f,
            least=MM * asked.scenario.least,
            most=MM * asked.scenario.most,
            seeds=campaigns.seeds_told(f.seed),
        ),
        answer=campaigns.beside_rivals("True error of 95 % in the check runs", f.gains),
        worst=_worst(f),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "short": Table(columns(SHORT, paper=False), f.models, headline=ERROR),
            "models": Table(columns(TABLE_II), f.models),
            "claims": Table(columns("claim verdict why"), f.claims, "The paper's statements"),
            "order": Table(columns(ORDER), [*f.order.MGCO69, *f.order.MGCO56], "The order m, Eq. (20)"),
        },
        body=["models", READING, "claims", OF_CLAIMS, "order", OF_ORDER],
        badge=own,
    )


def _found(asked: Settings, trials: Trials) -> Row:
    """Every number that is made of the trials."""
    scenario = asked.scenario
    fits, searched = trials.where(m=0).drop("m", "f_m_over_optimum"), trials.pick(trials["m"] > 0)
    straight, bent = (fits.where(truth=truth) for truth in TRUTHS)
    models, others = (merged(own.drop(*NOT_OF_A_MODEL), "name") for own in (straight, bent))
    least_squares, gco = (
        _best([m for m in models if m.constraint == constraint and m.structure != JOINTS])[0]
        for constraint in ("none", "psd")
    )
    duels = {"least_squares": (gco, least_squares), "joints": (gco, JOINTS)}
    models = campaigns.with_gains(models, straight, least_squares, ERROR, SECTION_5_2)
    others = campaigns.with_gains(others, bent, least_squares, ERROR, {})
    orders, best = merged(searched.drop(*NOT_OF_A_MODEL), "name", "m"), _best(models)
    by_model = {name: [row for row in orders if row.name == name] for name in ORDER_MODELS}
    return Row(
        dataset=Row(
            campaigns.dataset(straight, scenario.poses),
            sigma_urad=UM * scenario.sigma_rotation,
            noise_p95_mm=MM * math.sqrt(2 * chdtri(3, 0.05)) * scenario.sigma,  # of a read deflection
        ),
        models=[Row(m, nonlinear=other) for m, other in zip(models, others, strict=True)],
        order=Row(seeds=searched.values("seed"), **by_model),
        enough=[Row(model=name, m=_enough(rows)) for name, rows in by_model.items()],
        paired=_paired(straight, bent),
        ties=[_tie(straight), _tie(bent)],
        best=best,
        take=gco if gco in best else best[0],
        gains=campaigns.pairs(straight, duels, ERROR),
        gains_nonlinear=campaigns.pairs(bent, duels, ERROR),
        worst=campaigns.worst_trial(bent, gco, least_squares, JOINTS, value=ERROR),
    )


def _best(rows: Sequence[Row]) -> list[str]:
    """The models of least error; not the completed one, whose fit and predictions are those of MLS56."""
    errors = {m.name: m.check_true.p95_mm for m in rows if m.name != EQUAL_FIT}
    return list(best_of(errors, CLOSE).names)


def _paired(straight: Trials, bent: Trials) -> Row:
    """On the same data, by errors without noise: in how many seeds."""
    errors = dict(zip(MODELS, aligned(straight, MODELS, ERROR).T, strict=True))
    ours, mls32 = errors["MGCO56"], errors["MLS32"]
    others = np.min([errors[name] for name in MODELS if name != "MGCO56"], axis=0)
    return Row(
        seeds=len(ours),
        mgco56_best=wins(ours, others),
        mgco56_best_not=wins(others, ours),
        mgco56_near_mls32=int((np.abs(ours / mls32 - 1) <= CLOSE).sum()),
        mls32_better_than_mls56=wins(mls32, errors["MLS56"]),
        mls32_better_than_mls56_not=wins(errors["MLS56"], mls32),
        linear_is_enough=int((aligned(bent, ("MGCO56",), ERROR)[:, 0] <= (1 + CLOSE) * ours).sum()),
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
    sizes = np.array([(middle(row.f_m), middle(row.check_true.p95_mm)) for row in rows])
    return int(rows[int((sizes <= SAME * sizes[-1]).all(axis=1).argmax())].m)


def _which_m(f: Row) -> Markdown:
    least = listed([f"m = {own.m} on for {own.model}" for own in f.enough])
    return say("Order m: 6 always serves. F_M and check error are as good from {least}.", least=least)


def _worst(f: Row) -> Markdown:
    """With the non-linear truth, and where with the linear one."""
    at = f.map.worst[f.gains.least_squares.ours]
    return say(
        "Worst trial with non-linear truth, seed {worst}: {a.ours} {mm[0]:.3f} mm, least squares {mm[1]:.3f} "
        "mm, joint stiffness only {mm[2]:.3f} mm. With linear truth{seed} at {at.position_m:place}: "
        "{at.error_mm:.3f} mm, least squares {rival:.3f} mm.",
        a=f.gains_nonlinear.least_squares,
        worst=f.worst.seed,
        mm=[*f.worst.errors.values()],
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
    same = " {best:list} differ by at most 2 %." if len(f.best) > 1 else ""
    yield say(
        "Against noisy readings {name} errs {check.p95_mm:~.3f} mm, noise alone {noise:.3f} mm: readings "
        f"hardly distinguish these models.{same}",
        next(m for m in f.models if m.name == f.gains.joints.ours),
        noise=f.dataset.noise_p95_mm,
        best=f.best,
    )
    yield say(
        "Of the paper's {n} statements {held} are confirmed or consistent; their table says why others are "
        "not.",
        n=len(f.claims),
        held=sum(own.verdict in paper.HELD for own in f.claims),
    )
    yield f.which_m


def _judged(f: Row) -> Iterator[Row]:
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
        yield paper.comparison(claim, test, f.paired[key], f.paired[f"{key}_not"], f.paired.seeds)
    for claim, key, test in NEAR:
        yield paper.nearly(claim, test, f.paired[key], f.paired.seeds)


def _cells(m: Row) -> Iterator[Row]:
    """The cells of Table II that the paper's text gives of a model."""
    differs = "another arm and a single draw"
    if m.name == "MGCO69":
        differs += "; links 1, 4, 5 and 6, which MGCO69 takes for rigid, weigh differently on ours"
    for column in CELLS:
        if known := column.known_value(m):
            words = "mm, 95 %" if column.unit == "mm" else "% at most"
            yield paper.number(f"{m.name}: {known:g} {words}", column.value(m), known, differs)


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model under both truths."""
    f = Row(found.numbers)
    reading = "Errors of 95 % of the check runs. Dotted: joint stiffness only; diamonds: the paper's."
    answer = f"{f.arm}, section 5.2, true error of 95 % in the check runs: {campaigns.gains_told(f.gains)}"
    table = found.led(Table(columns(TABLE_II), f.models))
    return {"six_dof_arm.png": forest(table, PANES, answer, reading, JOINTS)}


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed, linear truth; what the page draws."""
    asked = run.settings
    cell = build_cell(find_arm(asked.arm))
    write_runs(run, cell, asked.scenario.poses)
    return calibration_scene(run, cell, asked.scenario, asked.scenario.poses)


STUDY = Study(
    name="six_dof_arm",
    about="Identify the models of Table I and two baselines from 108 runs, and check them on 120 others.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(100, 5),
    row=trial.SixDofRow,
    trials=trial.trials,
    report=report,
    printed=("short",),
    figures=figures,
    write=write,
    models="name",
)
