"""What the trials say: every model judged over the workspace, and which one to take."""

from collections.abc import Iterator

from testbench.arm.catalogue import find_arm
from testbench.campaign.baselines import JOINTS, distinct
from testbench.campaign.campaign import build_cell
from testbench.campaign.model_selection import DEFAULT
from testbench.campaign.true_arms import CALLED, FAMILY, member, true_cell
from testbench.data.write import write_csv
from testbench.report.campaigns import TRUE, arm_table, best, by_arm, error_map, pairs, recommended
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, find, merged, paired
from testbench.studies.calibration_scene import calibration_scene, runs_of
from testbench.studies.gravity_calibration.trial import Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.study import Run
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, forest, of_seeds
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
    "name parameters rank conservative status f_m f_m_floor identification.rms_mm check.rms_mm "
    f"check_true.rms_mm check.max_mm check.max_relative_percent {TRUE} times_less"
)
READING = Markdown(
    "Square brackets hold the paper's number where it is known. The paper measured a real robot, we simulate "
    "others, with other poses and noise: neither confirms the other. Errors are distances at the markers: "
    "against readings for fit and check (noise included, as in the paper), against the true deflection where "
    "the heading says true. Joints: joint stiffness only, links rigid. PSD of equal fit: the conservative "
    "model nearest to least squares among those that fit as well; least squares itself where there is none. "
    "The floor of F_M is what noise alone leaves. The prior is twice too soft and 30 % wrong in shape, on "
    "purpose; its error is estimated from the readings."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every model, and which is best where."""
    f = _numbers(asked, seeds, trials)
    told = distinct(f.models)
    arms = [row for row in f.by_arm if row.name in {m.name for m in told}]
    by_arm = Table((), arms, "RMS error over the workspace by true arm, mm", DEFAULT)
    return Report(
        scenario="gravity_calibration",
        question=say("{arm} under {payload_kg:g} kg: which stiffness model predicts its sag best?", f),
        title=_title(f),
        answer=say(
            "True RMS error over the workspace: {a.ours} {a.ours_mm:~.3f} mm, least squares "
            "{a.theirs_mm:~.3f} mm; {a:less seed}. Joint stiffness only {b.theirs_mm:~.3f} mm, {b:more}.",
            a=f.gains.least_squares,
            b=f.gains.joints,
        ),
        worst=lines(_worst(f)),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "short": Table(columns(SHORT, paper=False), told, bold=DEFAULT, headline=TRUE),
            "models": Table(columns(MODELS), f.models, bold=DEFAULT),
            "by_arm": arm_table(by_arm, KNOWN[TRUE]),
        },
        body=["models", READING, "by_arm"],
    )


def _numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    models, scenario = merged(trials.drop(*NOT_OF_A_MODEL), "name"), asked.scenario
    told, kinds = distinct(models), trials.values("true_arm")
    least_squares = best(told, "none", prior=False)
    for model in models:
        gain = paired(trials, model.name, least_squares, TRUE)
        known = SECTION_6.get(model.name) if scenario.arm == PAPERS_ARM else None
        model |= {"times_less": gain and gain.times, "paper": known}
    duels = {
        "joints": (DEFAULT, JOINTS),
        "same_prior": (DEFAULT, best(told, "none", prior=True)),
        "least_squares": (DEFAULT, least_squares),
        "best": (DEFAULT, recommended(told)),
        "gco_joints": (best(told, "psd", prior=False), JOINTS),
        "cone": ("MGCO56", "MLS56"),
    }
    return Row(
        seed=seeds[0] if len(seeds) == 1 else list(seeds),
        arm=scenario.arm,
        payload_kg=scenario.mass,
        truth=scenario.truth,
        noise=scenario.noise,
        dataset=merged(trials.where(name=trials["name"][0]).inside("measured"))[0],
        true_arm=kinds[0] if len(kinds) == 1 else FAMILY,
        true_arms=kinds,
        models=models,
        recommended=recommended(told),
        take=DEFAULT,
        gains=pairs(trials, duels),
        by_arm=by_arm(trials, TRUE),
        map=error_map(trials.where(name={m.name for m in told}), (least_squares, JOINTS, DEFAULT)),
    )


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


def _worst(f: Row) -> Iterator[str]:
    """With which true arm, and where, the model to take errs most."""
    if own := [row for row in f.by_arm if row.name == f.take]:
        most = max(own, key=lambda row: middle(row.workspace.rms_mm))
        yield say(
            "Worst with {arm}, medians: {name} errs {workspace.rms_mm:~.3f} mm, joint stiffness only "
            "{rival:~.3f} mm.",
            most,
            arm=CALLED[most.true_arm],
            rival=find(f.by_arm, name=JOINTS, true_arm=most.true_arm).workspace.rms_mm,
        )
    at = f.map.worst[f.take]
    seed = f" of seed {f.seed[0]}" if isinstance(f.seed, list) else ""
    yield say(
        f"Worst place{seed} at {{position_m:place}}: {{take}} errs {{error_mm:.3f}} mm, joint stiffness only "
        "{rival:.3f} mm. Joints there: {joints}.",
        vars(at),
        take=f.take,
        rival=f.map.error_mm[JOINTS][at.place],
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    best_, same, plain = (f.gains.get(name) for name in ("best", "same_prior", "gco_joints"))
    if best_:
        yield say(
            "Marked: {ours}, the default of `testbench identify`. {theirs} is the conservative model of "
            "least error: {it:more}.",
            best_,
            it=best_,
        )
    else:
        yield say("Take {take}, marked: no other conservative model errs less over the workspace.", f)
    yield say(
        "Least squares with the same prior errs {a.theirs_mm:~.3f} mm ({a.theirs}): {a:more}. Without a "
        "prior, GCO ({b.ours}) errs {b.ours_mm:~.3f} mm, joint stiffness only {b.theirs_mm:~.3f} mm, "
        "{b:more seed}.",
        a=same,
        b=plain,
    )
    if names := [m.name for m in f.models if m.held_by_trace_weight > 0.5]:
        yield say(
            "Do not use {names:list} away from the measured poses: only the trace weight limits the "
            "compliance that the readings cannot see.",
            names=names,
        )


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model."""
    f = Row(found.numbers)
    gains = {"least squares": f.gains.least_squares, "joint stiffness only": f.gains.joints}
    paper = "; grey diamonds: the paper" if any(m.paper for m in f.models) else ""
    return {
        "models.png": forest(
            Table(columns(MODELS), distinct(f.models), bold=DEFAULT),
            PANES,
            f"{f.arm} under {f.payload_kg:g} kg, RMS over the workspace: {beside(gains)}",
            f"RMS errors. {of_seeds(f.seed)}. Band: default; filled: prior; dotted: joint stiffness "
            f"only{paper}.",
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
