"""What the trials say: every model judged over the workspace, and which one to take."""

from collections.abc import Iterator

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, distinct
from testbench.bench.campaign import build_cell
from testbench.bench.default import DEFAULT
from testbench.bench.truths import CALLED, FAMILY
from testbench.report import campaigns
from testbench.report.campaigns import TRUE, arm_table, best, by_arm, error_map, pairs, recommended
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged, paired
from testbench.studies.gravity_calibration import trial
from testbench.studies.gravity_calibration.figure import residuals
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Run
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, forest, least, of_seeds
from testbench.views.gains import beside
from testbench.views.map_figure import error_map as map_figure
from testbench.views.markdown import Markdown
from testbench.views.page.page import Seen
from testbench.views.schema import Table, best_of

PAPERS_ARM = "kr500_l480"
PANES = {
    TRUE: "whole workspace, against the truth",
    "check_true.rms_mm": "check poses, against the truth",
    "check.rms_mm": "check poses, against readings",
}
"""Columns that are drawn, where it matters first."""
SHORT = f"name parameters rank conservative identification.rms_mm check.rms_mm {TRUE} times_less"
MODELS = (
    "name parameters rank conservative f_m f_m_floor identification.rms_mm check.rms_mm check_true.rms_mm "
    f"check.p95_mm check.max_mm check.max_relative_percent {TRUE} times_less"
)
FITS = (
    "name method status duality_gap f_m_excess_bound min_eigenvalue solve_seconds "
    "residuals.identification.mean_um residuals.identification.std_um residuals.identification.lilliefors_p "
    "residuals.check.mean_um residuals.check.std_um residuals.check.lilliefors_p"
)
PAIRS = "ours theirs ours_mm theirs_mm times won"
READING = Markdown(
    "Square brackets hold the paper's number where it is known. The paper measured a real robot, we simulate "
    "others, with other poses and noise: neither confirms the other. Errors are distances at the markers: "
    "against readings for fit and check (noise included, as in the paper), against the true deflection where "
    "the heading says true. Joints: joint stiffness only, links rigid. PSD of equal fit: the conservative "
    "model nearest to least squares among those that fit as well; least squares itself where there is none. "
    "The floor of F_M is what noise alone leaves, sqrt(3 (1 - seen / equations))."
)
OF_FITS = Markdown(
    "The duality gap bounds how far F_M plus the trace term, the program that is solved, is above its least "
    "value. The next column bounds what the trace weight adds to F_M. Both hold for all conservative models "
    "whose blocks have at most the traces in report.json. Residuals are components along one axis; a p below "
    "0.05 rejects normality."
)


def report(asked: trial.Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every model, and which is best where."""
    models = [_with_status(row, trials) for row in merged(trials.drop(*SEEDS), "name")]
    told = distinct(models)
    least_squares, gco = best(told, "none", prior=False), best(told, "psd", prior=False)
    chosen, scenario = recommended(told), asked.scenario
    take = DEFAULT if DEFAULT in trials.values("name") else chosen
    gains = pairs(
        trials,
        {
            "joints": (take, JOINTS),
            "same_prior": (take, best(told, "none", prior=True)),
            "least_squares": (take, least_squares),
            "best": (take, chosen),
            "gco": (gco, least_squares),
            "gco_joints": (gco, JOINTS),
            "joints_prior": (take, f"{JOINTS} + prior"),
            "cone_joints": ("MGCO56", JOINTS),
            "cone": ("MGCO56", "MLS56"),
            "cone_with_prior": ("MGCO56 + prior", "MLS56 + prior"),
        },
    )
    for model in models:
        gain = paired(trials, model.name, least_squares, TRUE)
        known = SECTION_6.get(model.name) if scenario.arm == PAPERS_ARM else None
        model |= {"times_less": gain and gain.times, "paper": known}
    kinds = trials.values("true_arm")
    f = Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=scenario.arm,
        payload_kg=scenario.mass,
        truth=scenario.truth,
        noise=scenario.noise,
        dataset=merged(trials.where(name=trials["name"][0]).keep("measured."))[0].measured,
        true_arm=kinds[0] if len(kinds) == 1 else FAMILY,
        true_arms=kinds,
        models=models,
        recommended=chosen,
        take=take,
        gains=gains,
        by_arm=by_arm(trials, TRUE),
        check_best=list(best_of({m.name: m.check_true.rms_mm for m in told if m.conservative is True}).names),
        map=error_map(trials.where(name={m.name for m in told}), (least_squares, JOINTS, take)),
    )
    names, arms = {m.name for m in told}, "RMS error over the workspace by true arm, mm"
    own = Table((), [row for row in f.by_arm if row.name in names], arms, take)
    tables = {
        "short": Table(columns(SHORT, paper=False), told, bold=take, headline=TRUE),
        "models": Table(columns(MODELS), models, bold=take),
        "pairs": Table(columns(PAIRS), _once(gains), "Pairs of models, over the workspace"),
        "by_arm": arm_table(own, KNOWN[TRUE]),
        "fits": Table(columns(FITS), models, "Fits"),
    }
    return Report(
        scenario="gravity_calibration",
        question=say("{arm} under {payload_kg:g} kg: which stiffness model predicts its sag best?", f),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=lines(_worst(f)),
        claims=list(_claims(f, models)),
        numbers=f,
        tables=tables,
        body=["models", READING, "pairs", "by_arm", "fits", OF_FITS, *_advice(models)],
    )


SEEDS = ("seed", "measured.", "true_arm", "places.", "place_mm")  #: Columns that are not of a model.


def _with_status(row: Row, trials: Trials) -> Row:
    """A model that is solved in some seeds only, with their number."""
    status = trials.where(name=row.name)["status"].tolist()
    solved = status.count("solved")
    if 0 < solved < len(status):
        row["status"] = f"solved in {solved} of {len(status)} seeds"
    return row


def _once(gains: Row) -> list[Row]:
    """Pairs, each once."""
    return list({(pair.ours, pair.theirs): pair for pair in gains.values()}.values())


def _title(f: Row) -> Markdown:
    """What was measured."""
    noise = "sigma {dataset.sigma_um:g} um" if f.noise else "noise-free"
    seeds = "{n} seeds: median ({ends})" if isinstance(f.seed, list) else "seed {seed}"
    return say(
        "{arm} under {payload_kg:g} kg: {dataset.runs} runs in {dataset.poses} poses, "
        "{dataset.identification_points} points identify, {dataset.check_points} check; markers move "
        "{dataset.deflection_min_mm:.2f} to {dataset.deflection_max_mm:.2f} mm; "
        f"{noise}, {{truth}} truth, true arms: {{arms:list}}; {seeds}",
        f,
        arms=[CALLED[arm] for arm in f.true_arms],
        n=len(f.seed) if isinstance(f.seed, list) else 1,
        ends=span(len(f.seed)) if isinstance(f.seed, list) else "",
    )


def _answer(f: Row) -> Iterator[str]:
    """What the model to take gains, beside the strongest rival first."""
    if "least_squares" in f.gains:
        yield say(
            "True RMS error over the workspace: {ours} {ours_mm:~.3f} mm, least squares {theirs_mm:~.3f} mm; "
            "{it:less seed}.",
            _pair(f, "least_squares"),
        )
    if "joints" in f.gains:
        yield say("Joints alone {theirs_mm:~.3f} mm, {it:more}.", _pair(f, "joints"))
    if not f.take:
        yield "No model is conservative in every seed: none is recommended."
    elif "least_squares" not in f.gains:
        own = next(m for m in f.models if m.name == f.take)
        yield say("Over the workspace {name} errs by {workspace.rms_mm:.3f} mm RMS, against the truth.", own)


def _worst(f: Row) -> Iterator[str]:
    """With which true arm, and where, it errs most."""
    own = [row for row in f.by_arm if row.name == f.take]
    if own:
        arm = max(own, key=lambda row: middle(row.workspace.rms_mm)).true_arm
        mm = {row.name: row.workspace.rms_mm for row in f.by_arm if row.true_arm == arm}
        yield say(
            "Worst with {arm}, medians: {take} errs {own:~.3f} mm, joints alone {joints:~.3f} mm.",
            f | {"arm": CALLED[arm], "own": mm[f.take], "joints": mm[JOINTS]},
        )
    if f.take in f.map.worst:
        at = f.map.worst[f.take]
        seed = f" of seed {f.seed[0]}" if isinstance(f.seed, list) else ""
        mm = {name: own[at.place] for name, own in f.map.error_mm.items()}
        rival = ", joints alone {rival:.3f} mm" if JOINTS in mm else ""
        yield say(
            f"Worst place{seed} at {{position_m:place}}: {{take}} errs {{error_mm:.3f}} mm{rival}. "
            "Joints there: {joints}.",
            vars(at),
            take=f.take,
            rival=mm.get(JOINTS),
        )


def _claims(f: Row, models: list[Row]) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    if f.take == f.recommended:
        yield say("Take {take}, marked: no other conservative model errs less over the workspace.", f)
    elif "best" in f.gains:
        yield say(
            "Marked: {ours}, the default of `testbench identify`. {theirs} is the conservative model of "
            "least error: {it:more}.",
            _pair(f, "best"),
        )
    if "same_prior" in f.gains:
        yield say(
            "Least squares with the same prior errs {theirs_mm:~.3f} mm ({theirs}): {it:more}.",
            _pair(f, "same_prior"),
        )
    if "gco_joints" in f.gains:
        yield say(
            "Without a prior, GCO ({ours}) errs {ours_mm:~.3f} mm: beside joints alone {it:less seed}.",
            _pair(f, "gco_joints"),
        )
    if names := [m.name for m in models if m.held_by_trace_weight > 0.5]:
        yield say(
            "Do not use {names:list} away from the measured poses: only the trace weight limits the "
            "compliance that the readings cannot see.",
            names=names,
        )
    yield Markdown(
        "The prior is twice too soft and 30 % wrong in shape, on purpose; its error is estimated from the "
        "readings."
    )
    yield from _notes(f, models)


def _notes(f: Row, models: list[Row]) -> Iterator[Markdown]:
    """What is said of single models."""
    several = isinstance(f.seed, list)
    for m in models:
        if m.constraint == "free" and m.conservative is False:
            end = " in any seed" if several else ""
            yield say(f"No conservative model fits as well as least squares of {{structure}}{end}.", m)
        elif m.constraint == "free":
            yield say(
                "{name} exists in {conservative:yes} of the seeds.",
                m | {"conservative": float(m.conservative)},
            )
    if f.check_best:
        yield say("The best conservative models at the check poses, against the truth: {check_best:list}.", f)
    if names := [m.name for m in models if m.conservative is not True and m.constraint != "free"]:
        yield say("Not conservative{seeds}: {names:list}.", names=names, seeds=" in every seed" * several)
    if any(m.unique is not True and not m.prior for m in models):
        yield Markdown(
            "The readings determine fewer directions than there are unknowns. Without a prior, minimum norm "
            "(LS) or least trace (GCO) fills the rest: single entries mean nothing then."
        )
    for m in models:
        if m.status != "solved" and m.constraint != "free":
            yield say("Not certified: {name} ({status}).", m)
    yield Markdown("Only a simulation tells which model is best over the workspace.")


def _pair(f: Row, pair: str) -> Row:
    """A pair for a sentence: its numbers, and itself as `it`."""
    return Row(f.gains[pair], it=f.gains[pair])


def _advice(models: list[Row]) -> list[Markdown]:
    """What the estimates say of themselves, each once."""
    texts = dict.fromkeys(text for m in models for text in m.advice)
    return [Markdown("\n".join(say("- {text}", text=text) for text in texts))] if texts else []


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model, and where the models that are compared err."""
    f = Row(found.numbers)
    title = f"{f.arm} under {f.payload_kg:g} kg"
    gains = {"least squares": f.gains.get("least_squares"), "joints alone": f.gains.get("joints")}
    told = distinct(f.models)
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in told}, JOINTS)
    paper = "; grey diamonds: the paper" if any(m.paper for m in f.models) else ""
    reading = f"RMS errors. {of_seeds(f.seed)}. Filled: with a prior; dotted line: joints alone{paper}."
    errors = Table(columns(MODELS), told)
    return {
        "models.png": forest(errors, PANES, f"{title}, RMS over the workspace: {said}", reading, JOINTS),
        "error_map.png": map_figure(f.map, title, f.seed),
    }


def write(run: Run[trial.Settings]) -> Seen:
    """dataset.csv and residuals.png of the first seed; what is drawn of it."""
    f, asked = Row(run.report.numbers), run.settings
    true, campaign = trial.calibrate(build_cell(find_arm(asked.arm)), asked, run.seeds[0])
    named = {m.name for m in distinct(f.models)}
    results = [result for result in trial.results(true, campaign) if result.model.name in named]
    residuals(campaign, results, f.take).savefig(run.folder / "residuals.png")
    made = true, campaign, results
    return campaigns.write(run.report, run.folder, made, asked.magnification)
