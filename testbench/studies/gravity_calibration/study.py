"""Section 6 in simulation: a heavy arm under a hung weight, three markers, LS against GCO."""

from collections.abc import Iterator

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.evaluation import CampaignRow
from testbench.campaign.model_selection import DEFAULT
from testbench.campaign.models import JOINTS
from testbench.campaign.true_arms import CALLED, FAMILY, member, true_cell
from testbench.report import badge, campaigns
from testbench.report.campaigns import NOT_OF_A_MODEL, TRUE, best, distinct
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials, merged
from testbench.studies.calibration_scene import calibration_scene, write_runs
from testbench.studies.gravity_calibration import trial
from testbench.studies.gravity_calibration.trial import Settings
from testbench.studies.paper import SECTION_6
from testbench.studies.rivals import IN_PAPER, SAME
from testbench.studies.study import Run, Study
from testbench.views.figure import Figure, forest
from testbench.views.markdown import Markdown
from testbench.views.scene import Seen
from testbench.views.schema import Table, pivot

PAPERS_ARM = "kr500_l480"
PANES = {
    TRUE: "whole workspace, against the truth",
    "check_true.rms_mm": "check poses, against the truth",
    "check.rms_mm": "check poses, against readings",
}
"""Columns that are drawn, where it matters first."""
SHORT = f"name parameters rank conservative check.rms_mm {TRUE}"
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
    "(paper): GCO without a trace weight, as in the paper; all other GCO without a prior learns its weight. "
    "The floor of F_M is what noise alone leaves. The prior is twice too soft and 30 % wrong in shape, on "
    "purpose; its error is estimated from the readings."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads of every model, and which is best where."""
    f = _numbers(asked, seeds, trials)
    told = distinct(f.models)
    own = badge.of_models(trials, told, DEFAULT, TRUE)
    f["map"] = campaigns.error_map(
        trials.where(name={m.name for m in told}),
        badge.drawn(own, trials["name"], *campaigns.own(told), best(told, "none", prior=False)),
    )
    arms = [row for row in f.by_arm if row.name in {m.name for m in told}]
    by_arm = Table((), arms, "RMS error over the workspace by true arm, mm")
    return Report(
        scenario=STUDY.name,
        question=say("{arm} under {payload_kg:g} kg: which stiffness model predicts its sag best?", f),
        title=say(
            "{arm} under {payload_kg:g} kg: {dataset.runs} runs in {dataset.poses} poses, "
            "{dataset.identification_points} points identify, {dataset.check_points} check; markers move "
            "{dataset.deflection_min_mm:.2f} to {dataset.deflection_max_mm:.2f} mm; {sigma}, {truth} truth, "
            "true arms: {arms:list}; {seeds}",
            f,
            sigma=say("sigma {sigma_um:g} um", f.dataset) if f.noise else "noise-free",
            arms=[CALLED[arm] for arm in f.true_arms],
            seeds=campaigns.seeds_told(f.seed),
        ),
        answer=campaigns.beside_rivals("True workspace RMS error", f.gains),
        worst=lines(_worst(f)),
        claims=list(_claims(f)),
        numbers=f,
        tables={
            "short": Table(columns(SHORT, paper=False), told, headline=TRUE),
            "models": Table(columns(MODELS), f.models),
            "by_arm": pivot(by_arm, *columns("name true_arm"), KNOWN[TRUE]),
        },
        body=["models", READING, "by_arm"],
        badge=own,
    )


def _numbers(asked: Settings, seeds: range, trials: Trials) -> Row:
    models, scenario = merged(trials.drop(*NOT_OF_A_MODEL), "name"), asked.scenario
    told, kinds = distinct(models), trials.values("true_arm")
    least_squares, recommended = best(told, "none", prior=False), campaigns.recommended(told)
    duels = {
        "joints": (DEFAULT, JOINTS),
        "same_prior": (DEFAULT, SAME),
        "least_squares": (DEFAULT, least_squares),
        "best": (DEFAULT, recommended),
        "gco_joints": (best([m for m in told if not m.name.endswith(IN_PAPER)], "psd", prior=False), JOINTS),
        "cone": ("MGCO56", "MLS56"),
    }
    paper = SECTION_6 if scenario.arm == PAPERS_ARM else {}
    paper = paper | {f"{name}{IN_PAPER}": cells for name, cells in paper.items()}
    return Row(
        seed=campaigns.seeds_of(seeds),
        arm=scenario.arm,
        payload_kg=scenario.mass,
        truth=scenario.truth,
        noise=scenario.noise,
        dataset=campaigns.dataset(trials),
        true_arm=kinds[0] if len(kinds) == 1 else FAMILY,
        true_arms=kinds,
        models=campaigns.with_gains(models, trials, least_squares, TRUE, paper),
        recommended=recommended,
        take=DEFAULT,
        gains=campaigns.pairs(trials, duels),
        by_arm=campaigns.by_arm(trials, TRUE),
        worst=_worst_trial(trials) if len(seeds) > 1 else None,
    )


def _worst_trial(trials: Trials) -> Row:
    """The trial in which the default errs most, and its true arm."""
    found = campaigns.worst_trial(trials, DEFAULT, JOINTS)
    return Row(found, true_arm=trials.where(seed=found.seed)["true_arm"][0])


def _worst(f: Row) -> Iterator[str]:
    """In which trial, and where, the model to take errs most."""
    if f.worst:
        yield say(
            "Worst trial, seed {seed}, {arm}: {take} errs {ours:.3f} mm, joint stiffness only "
            "{theirs:.3f} mm.",
            f.worst,
            arm=CALLED[f.worst.true_arm],
            take=f.take,
            ours=f.worst.errors[f.take],
            theirs=f.worst.errors[JOINTS],
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
    if "best" in f.gains:
        yield say(
            "{ours} is the default of `testbench identify`. {theirs} has the fewest unknowns of the "
            "conservative models of least error: {it:more}.",
            f.gains.best,
            it=f.gains.best,
        )
    else:
        yield say("Take {take}: no other conservative model errs less over the workspace.", f)
    yield say(
        "Without the cone the same unknowns and prior err {a.theirs_mm:~.3f} mm ({a.theirs}): {a:more}. "
        "Without a prior, GCO ({b.ours}) errs {b.ours_mm:~.3f} mm, joint stiffness only {b.theirs_mm:~.3f} "
        "mm, {b:more seed}.",
        a=f.gains.same_prior,
        b=f.gains.gco_joints,
    )
    if names := [m.name for m in f.models if m.held_by_trace_weight > 0.5]:
        yield say(
            "Do not use {names:list} away from the measured poses: nothing limits the compliance that the "
            "readings cannot see. The same models with a learnt trace weight stand beside them.",
            names=names,
        )


def figures(found: Report) -> dict[str, Figure]:
    """Errors of every model."""
    f = Row(found.numbers)
    paper = "; grey diamonds: the paper" if any(m.paper for m in f.models) else ""
    return {
        "models.png": forest(
            found.led(Table(columns(MODELS), distinct(f.models))),
            PANES,
            f"{f.arm} under {f.payload_kg:g} kg, RMS over the workspace: {campaigns.gains_told(f.gains)}",
            f"RMS errors. Filled: prior; dotted: joint stiffness only{paper}.",
            JOINTS,
        )
    }


def write(run: Run[Settings]) -> Seen:
    """dataset.csv of the first seed; what the page draws."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    write_runs(run, cell)
    true = true_cell(cell, member(asked.true_arm, seed), seed)
    return calibration_scene(run, true, asked.scenario, asked.scenario.identification_poses)


STUDY = Study(
    name="gravity_calibration",
    about="Calibrate the arm under gravity as section 6 of the paper does, and judge its models.",
    options=trial.Options,
    settings=trial.settings,
    seeds=(1, 10_000),
    row=CampaignRow,
    trials=trial.trials,
    report=report,
    printed=("short",),
    figures=figures,
    write=write,
    size=4,
    models="name",
)
