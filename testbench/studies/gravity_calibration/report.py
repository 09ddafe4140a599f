"""What the trials say: every model judged over the workspace, and which one to take."""

from collections.abc import Iterator

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, distinct
from testbench.bench.campaign import build_cell
from testbench.bench.default import DEFAULT
from testbench.bench.truths import CALLED, FAMILY, member, true_cell
from testbench.data.csvfile import write_csv
from testbench.report.campaigns import TRUE, arm_table, best, by_arm, error_map, pairs, recommended
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged, paired
from testbench.studies.calibration_scene import calibration_scene, runs_of
from testbench.studies.gravity_calibration.trial import Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Run
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, forest, least, of_seeds
from testbench.views.gains import beside
from testbench.views.markdown import Markdown
from testbench.views.scene import Seen
from testbench.views.schema import Table

PAPERS_ARM = "kr500_l480"
PANES = {
    TRUE: "whole workspace, against the truth",
    "check_true.rms_mm": "check poses, against the truth",
    "check.rms_mm": "check poses, against readings",
}
"""Columns that are drawn, where it matters first."""
NOT_OF_A_MODEL = ("seed", "measured.", "true_arm", "places.", "place_mm", "drawn.")
SHORT = f"name parameters rank conservative identification.rms_mm check.rms_mm {TRUE} times_less"
MODELS = (
    "name parameters rank conservative f_m f_m_floor identification.rms_mm check.rms_mm check_true.rms_mm "
    f"check.p95_mm check.max_mm check.max_relative_percent {TRUE} times_less"
)
READING = Markdown(
    "Square brackets hold the paper's number where it is known. The paper measured a real robot, we simulate "
    "others, with other poses and noise: neither confirms the other. Errors are distances at the markers: "
    "against readings for fit and check (noise included, as in the paper), against the true deflection where "
    "the heading says true. Joints: joint stiffness only, links rigid. PSD of equal fit: the conservative "
    "model nearest to least squares among those that fit as well; least squares itself where there is none. "
    "The floor of F_M is what noise alone leaves, sqrt(3 (1 - seen / equations)). The prior is twice too "
    "soft and 30 % wrong in shape, on purpose; its error is estimated from the readings."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every model, and which is best where."""
    f = _numbers(asked, seeds, trials)
    told = distinct(f.models)
    names, arms = {m.name for m in told}, "RMS error over the workspace by true arm, mm"
    own = Table((), [row for row in f.by_arm if row.name in names], arms, f.take)
    return Report(
        scenario="gravity_calibration",
        question=say("{arm} under {payload_kg:g} kg: which stiffness model predicts its sag best?", f),
        title=_title(f),
        answer=lines(_answer(f)),
        worst=lines(_worst(f)),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "short": Table(columns(SHORT, paper=False), told, bold=f.take, headline=TRUE),
            "models": Table(columns(MODELS), f.models, bold=f.take),
            "by_arm": arm_table(own, KNOWN[TRUE]),
        },
        body=["models", READING, "by_arm"],
    )


def _numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    models = [_with_status(row, trials) for row in merged(trials.drop(*NOT_OF_A_MODEL), "name")]
    told, scenario = distinct(models), asked.scenario
    least_squares, gco = best(told, "none", prior=False), best(told, "psd", prior=False)
    chosen, kinds = recommended(told), trials.values("true_arm")
    take = DEFAULT if DEFAULT in trials.values("name") else chosen
    for model in models:
        gain = paired(trials, model.name, least_squares, TRUE)
        known = SECTION_6.get(model.name) if scenario.arm == PAPERS_ARM else None
        model |= {"times_less": gain and gain.times, "paper": known}
    duels = {
        "joints": (take, JOINTS),
        "same_prior": (take, best(told, "none", prior=True)),
        "least_squares": (take, least_squares),
        "best": (take, chosen),
        "gco": (gco, least_squares),
        "gco_joints": (gco, JOINTS),
        "cone": ("MGCO56", "MLS56"),
        "cone_with_prior": ("MGCO56 + prior", "MLS56 + prior"),
    }
    return Row(
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
        gains=pairs(trials, duels),
        by_arm=by_arm(trials, TRUE),
        map=error_map(trials.where(name={m.name for m in told}), (least_squares, JOINTS, take)),
    )


def _with_status(row: Row, trials: Trials) -> Row:
    """A model that is solved in some seeds only, with their number."""
    status = trials.where(name=row.name)["status"].tolist()
    solved = status.count("solved")
    if 0 < solved < len(status):
        row["status"] = f"solved in {solved} of {len(status)} seeds"
    return row


def _title(f: Row) -> Markdown:
    """What was measured."""
    noise = "sigma {dataset.sigma_um:g} um" if f.noise else "noise-free"
    several = isinstance(f.seed, list)
    seeds = f"{len(f.seed)} seeds: median ({span(len(f.seed))})" if several else f"seed {f.seed}"
    return say(
        "{arm} under {payload_kg:g} kg: {dataset.runs} runs in {dataset.poses} poses, "
        "{dataset.identification_points} points identify, {dataset.check_points} check; markers move "
        "{dataset.deflection_min_mm:.2f} to {dataset.deflection_max_mm:.2f} mm; "
        f"{noise}, {{truth}} truth, true arms: {{arms:list}}; {seeds}",
        f,
        arms=[CALLED[arm] for arm in f.true_arms],
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


def _claims(f: Row) -> Iterator[Markdown]:
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
    if names := [m.name for m in f.models if m.held_by_trace_weight > 0.5]:
        yield say(
            "Do not use {names:list} away from the measured poses: only the trace weight limits the "
            "compliance that the readings cannot see.",
            names=names,
        )
    stalled = [f"{m.name} ({m.status})" for m in f.models if m.status != "solved" and m.constraint != "free"]
    if stalled:
        yield say("Not certified: {models:list}.", models=stalled)


def _pair(f: Row, pair: str) -> Row:
    """A pair for a sentence: its numbers, and itself as `it`."""
    return Row(f.gains[pair], it=f.gains[pair])


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model."""
    f, told = Row(found.numbers), distinct(found.numbers["models"])
    gains = {"least squares": f.gains.get("least_squares"), "joints alone": f.gains.get("joints")}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in told}, JOINTS)
    paper = "; grey diamonds: the paper" if any(m.paper for m in f.models) else ""
    return {
        "models.png": forest(
            Table(columns(MODELS), told),
            PANES,
            f"{f.arm} under {f.payload_kg:g} kg, RMS over the workspace: {said}",
            f"RMS errors. {of_seeds(f.seed)}. Filled: with a prior; dotted line: joints alone{paper}.",
            JOINTS,
        )
    }


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed; what the page draws."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    measured, _ = runs_of(cell, asked.scenario, run.first)
    write_csv(measured, cell.arm, run.folder / "dataset.csv")
    true = true_cell(cell, member(asked.true_arm, seed), seed)
    return calibration_scene(run, true, asked.scenario, asked.scenario.identification_poses)
