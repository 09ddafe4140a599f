"""The `testbench` command: an engineer's own arm and own data.

check ARM, elastic ARM FILE, plan ARM --task TASKS --out DIR, simulate ARM POSES --out DATA, identifiability
ARM DATA, identify ARM DATA --out DIR; view DIR and shot DIR for the recordings of any run.
"""

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from testbench import files
from testbench.arm.folder import load_arm
from testbench.bench import plan as plans
from testbench.bench.campaign import MODELS, Scenario, build_cell, measure, named_models, stream
from testbench.bench.fit import Wish, fit, recommend
from testbench.cli import planfile
from testbench.data.csvfile import read_csv, read_poses, write_csv
from testbench.data.dataset import Dataset, split
from testbench.data.tracker import Tracker
from testbench.errors import BenchError, InputError
from testbench.identify.evaluate import predict, score
from testbench.identify.identifiability import describe
from testbench.identify.plausibility import doubts
from testbench.identify.prior import cad_prior
from testbench.identify.regularised import Strength
from testbench.model.vjm import chain
from testbench.plant import check_poses, settle_linear, write_elastic
from testbench.shell import command
from testbench.studies.identifiability.figure import shares
from testbench.views import identifiability_text, plan_report, plan_text, tables
from testbench.views.identifiability_report import to_dict
from testbench.views.report import fit_report

app = typer.Typer(add_completion=False, help="Virtual calibration cell for heavy robot arms.")
console = Console(highlight=False)

AGREEMENT, AGREEMENT_POSES = 1e-9, 20
"""Distance of the tool between the two readings of an arm [m], and poses in which it is compared."""

HUNG = 460.3
"""Mass that hangs where nothing else is said [kg]."""

ArmFolder = Annotated[Path, typer.Argument(help="Folder with rigid.xml and elastic.toml.")]
RunFolder = Annotated[Path, typer.Argument(help="Folder of a run, or one recording.")]


@app.command()
def check(arm: ArmFolder) -> None:
    """Read an arm's folder with both libraries; say what is in it, or what is wrong with it."""
    cell = build_cell(arm)
    console.print(f"{cell.arm.name}: {cell.arm.title}")
    for k, link in enumerate(cell.arm.links):
        tip, turn = link.compliance[1, 1], link.compliance[5, 5]
        console.print(f"  {link.name}: bends {tip:.3g} m/N and {turn:.3g} rad/(N m) at its end")
        if k < cell.arm.n_joints:
            joint = cell.arm.joints[k]
            low, high = np.rad2deg([joint.lower, joint.upper])
            console.print(f"  {joint.name}: {low:.0f} to {high:.0f} deg, {joint.compliance:.3g} rad/(N m)")
    markers = ", ".join(cell.arm.markers)
    console.print(f"  tool {cell.arm.tool}, load point {cell.arm.load}, markers {markers}")
    lower, upper = cell.arm.limits
    q = stream(0).uniform(lower, upper, (AGREEMENT_POSES, cell.arm.n_joints))
    idle = np.zeros((AGREEMENT_POSES, 6))
    rest, where = settle_linear(cell.plant, q, idle, idle[:, :3]), chain(cell.vjm, q)
    nominal = where.position[:, None] + cell.vjm.markers @ where.rotation.transpose(0, 2, 1)
    apart = max(
        np.abs(rest.tool - where.position).max(),
        np.abs(rest.markers - nominal).max(),
        np.abs(cell.plant.load - cell.vjm.load).max(),
    )
    if apart > AGREEMENT:
        raise BenchError(f"{arm}: MuJoCo and Pinocchio place tool, load or markers {apart:.1e} m apart")
    console.print(f"MuJoCo and Pinocchio place tool, load and markers alike, within {apart:.0e} m")


@app.command()
def elastic(arm: ArmFolder, file: Annotated[Path, typer.Argument(help="MJCF to write.")]) -> None:
    """Write the elastic arm as plain MJCF for MuJoCo's own viewer."""
    write_elastic(load_arm(arm), file)
    console.print(f"{file}; open it with: .venv/bin/python -m mujoco.viewer --mjcf={file}", soft_wrap=True)


@app.command()
def plan(
    arm: ArmFolder,
    task: Annotated[Path, typer.Option(help="CSV of tasks: JOINT_rad or JOINT_deg, force_x_N ... if any.")],
    load: Annotated[list[float], typer.Option(help="Mass to hang in kg; again for a choice.")],
    poses: Annotated[int, typer.Option(help="How many to measure.")] = 12,
    tracker: Annotated[str | None, typer.Option(help="Where it stands: x,y,z in m.")] = None,
    acceptance_deg: Annotated[
        float | None, typer.Option(help="Half angle of fixed targets; turned by hand if not given.")
    ] = None,
    box: Annotated[str | None, typer.Option(help="Where the tool may be: x0,y0,z0,x1,y1,z1 in m.")] = None,
    criterion: Annotated[str, typer.Option(help="test, D, A, E, G or I.")] = "test",
    model: Annotated[str, typer.Option(help="Model that is to be identified.")] = "MGCO68",
    sigma_um: Annotated[float, typer.Option(help="Noise of a reading along an axis.")] = 50.0,
    uncertainty_percent: Annotated[
        float | None, typer.Option(help="Of the CAD prior, 30 if not given.")
    ] = None,
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Plan for a fit without a prior.")] = False,
    candidates: Annotated[int, typer.Option(help="Feasible poses to choose from.")] = 5000,
    sling_m: Annotated[float, typer.Option(help="From the load point to the weight.")] = 0.5,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the plan.")] = Path("runs/plan"),
) -> None:
    """Plan a calibration: the poses that tell most about the tasks, and what they promise."""
    if uncertainty_percent is not None and no_prior:
        raise BenchError("--uncertainty-percent: expected no --no-prior with it")
    if acceptance_deg is not None and tracker is None:
        raise BenchError("--acceptance-deg: expected --tracker with it")
    cell = build_cell(arm)
    percent = 30.0 if uncertainty_percent is None else uncertainty_percent
    wish = plans.Wish(
        structure=plans.structure(cell, model),
        tasks=planfile.read_tasks(task, cell, plans.hung(cell, load[0])),
        loads=tuple(load),
        poses=poses,
        criterion=criterion,
        sigma=sigma_um / 1e6,
        uncertainty=None if no_prior else percent / 100,
        station=None if tracker is None else planfile.parse_station(tracker, acceptance_deg),
        area=None if box is None else planfile.parse_box(box),
        sling=sling_m,
        candidates=candidates,
        seed=seed,
    )
    with console.status("looking for feasible poses") as status:
        found = plans.search(cell, wish)
        status.update(f"choosing {poses} of {len(found.q)} poses")
        brief = plans.brief_of(cell, wish)
        chosen = plans.choose(cell, wish, brief, found)
        status.update("judging the plan")
        planned = plans.judge(cell, wish, brief, found, chosen)
        status.update("writing")
        report = plan_report.report(cell, planned)
        planfile.write_all(cell, planned, report, arm=arm, task=task, out=out)
    console.print(f"[bold]{plan_text.answer(report)}[/bold]")
    console.print(plan_text.table(report))
    for sentence in plan_text.sentences(report):
        console.print(f"- {sentence}")
    console.print(plan_text.where(out), soft_wrap=True)


@app.command()
def simulate(
    arm: ArmFolder,
    poses: Annotated[Path, typer.Argument(help="CSV of joint angles, columns JOINT_rad; or a plan.csv.")],
    out: Annotated[Path, typer.Option(help="Dataset to write, CSV.")],
    payload_kg: Annotated[
        float | None, typer.Option(help=f"Hung mass, {HUNG} if not given; a plan.csv has its own.")
    ] = None,
    sigma_um: Annotated[float, typer.Option(help="Noise of a reading along an axis.")] = 50.0,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of the noise.")] = 1,
) -> None:
    """Hang the payload on the true arm in every pose and read the markers before and after."""
    mass = HUNG if payload_kg is None else payload_kg
    scenario = Scenario(arm=arm.resolve().name, payload=mass, sigma=sigma_um / 1e6)
    cell = build_cell(arm)
    q = read_poses(poses, cell.arm)
    payload = planfile.read_payload(poses)
    if payload is not None and payload_kg is not None:
        raise InputError(poses, "column load_kg", "says what hangs in every run; leave out --payload-kg")
    check_poses(cell.room, q)
    ids, tracker = np.arange(len(q)) + 1, Tracker(scenario.sigma)
    data, _, _ = measure(cell, scenario, q, ids, tracker, stream(seed, 1), payload=payload)
    write_csv(data, tuple(j.name for j in cell.arm.joints), out)
    size = 1e3 * np.linalg.norm(data.deflection, axis=-1)
    text = f"{out}: {data.runs} runs, deflections {size.min():.2f} to {size.max():.2f} mm"
    console.print(text, soft_wrap=True)


@app.command()
def identify(
    arm: ArmFolder,
    dataset: Annotated[Path, typer.Argument(help="Measured runs, CSV.")],
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/identify"),
    model: Annotated[list[str] | None, typer.Option(help="Model to fit; may be given again.")] = None,
    check_pose: Annotated[list[int] | None, typer.Option(help="Pose to hold back; again for more.")] = None,
    full_pose: Annotated[
        bool, typer.Option("--full-pose", help="Insist on both terms of Eq. 19, positions and orientations.")
    ] = False,
    prior: Annotated[
        bool,
        typer.Option("--prior", help="Fill what the data cannot see with the arm's folder as CAD prior."),
    ] = False,
    uncertainty_percent: Annotated[
        float | None,
        typer.Option(help="Of the prior; cross-validated over poses if not given, 30 with --robust."),
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="Look for outliers and fit without them.")] = False,
) -> None:
    """Identify stiffness models from measured runs; says what the data cannot see."""
    cell = build_cell(arm)
    if uncertainty_percent is not None and not prior:
        raise BenchError("--uncertainty-percent: expected --prior with it")
    uncertainty = None if uncertainty_percent is None else uncertainty_percent / 100
    wish = Wish(cad_prior(cell.arm) if prior else None, uncertainty, robust)
    every = [name for name in MODELS if not (prior and name == "MLS32")]  # a prior is one of whole blocks
    chosen = named_models(cell, model or every)
    data = read_csv(dataset, cell.arm)
    if full_pose and data.rotation_before is None:
        problem = "expected rotation_before_*_rad, rotation_after_*_rad and sigma_rad for the rotation term"
        raise InputError(dataset, "header", f"{problem} (--full-pose); it has positions only")
    check, used = _held_back(data, check_pose)
    fits = []
    for entry in chosen:
        start = time.perf_counter()
        estimate, rejected = fit(cell, entry, used, wish)
        seconds = time.perf_counter() - start
        sets = {"identification": used} if check is None else {"identification": used, "check": check}
        scores = {
            k: score(predict(cell.vjm, estimate, d)[d.seen], d.deflection[d.seen]) for k, d in sets.items()
        }
        outliers = [asdict(reading) for reading in rejected]
        fits.append(fit_report(entry.name, estimate, scores, seconds, cell.arm) | {"rejected": outliers})
    with files.whole_folder(out) as folder:
        whole = {"dataset": dataset.name, "arm": cell.arm.name, "models": fits}
        files.write_json(whole, folder / "models.json")
    console.print(tables.fits(fits))
    for sentence in doubts(cell.vjm, data):
        console.print(f"- DOUBT: {sentence}")
    if len(chosen) > 1 and len(np.unique(used.pose)) > 1:
        name, candidates = recommend(cell, chosen, used, wish)
        listed = ", ".join(f"{c.name} {c.error:.2f} +- {c.standard_error:.2f}" for c in candidates)
        console.print(
            f"- recommended: {name}, the simplest within one standard error of the best; F_M on poses and "
            f"load levels held out in turn: {listed}"
        )
    if check is None:
        console.print("- no pose was held back (--check-pose): how well a model fits is not how it predicts")
    for sentence in dict.fromkeys(text for row in fits for text in row["advice"]):
        console.print(f"- {sentence}")
    console.print(f"models     {out / 'models.json'}", soft_wrap=True)


def _held_back(data: Dataset, check_pose: list[int] | None) -> tuple[Dataset | None, Dataset]:
    """The runs in the poses held back, None if there are none, and those to fit.

    Raises:
        BenchError: When a pose is not in the data, none is left on one side, or no target was read in those
            held back.
    """
    if not check_pose:
        return None, data
    check, used = split(data, np.array(check_pose))
    if not check.seen.any():
        raise BenchError(f"--check-pose: expected readings in pose {check_pose}, every target was lost there")
    return check, used


@app.command()
def identifiability(
    arm: ArmFolder,
    dataset: Annotated[Path, typer.Argument(help="Measured runs, CSV.")],
    model: Annotated[str, typer.Option(help="Model whose parameters are asked for.")] = "MGCO68",
    uncertainty_percent: Annotated[float, typer.Option(help="Of the CAD prior of the arm's folder.")] = 30.0,
    figure: Annotated[Path | None, typer.Option(help="PNG to write.")] = None,
) -> None:
    """Say what these runs can tell of a model before any fit, what they cannot, and what would help."""
    cell = build_cell(arm)
    if figure is not None and (figure.suffix != ".png" or not figure.parent.is_dir()):
        raise InputError(figure, "", "expected the name of a .png in a folder that exists")
    [entry] = named_models(cell, [model])
    data = read_csv(dataset, cell.arm)
    strength = Strength(uncertainty_percent / 100)
    seen = describe(cell.vjm, entry.structure, data, cad_prior(cell.arm), strength)
    console.print(identifiability_text.table(seen))
    for sentence in identifiability_text.sentences(seen):
        console.print(f"- {sentence}")
    if figure is not None:
        shares(to_dict(seen), figure)
        console.print(f"figure     {figure}", soft_wrap=True)


@app.command()
def view(folder: RunFolder) -> None:
    """Open the newest recording of a run in the Rerun viewer."""
    from testbench.views.recording import viewer  # here: importing rerun takes a third of a second

    viewer.view(folder)


@app.command()
def shot(
    folder: RunFolder,
    out: Annotated[Path, typer.Option(help="PNG to write.")] = Path("recording.png"),
    tab: Annotated[str | None, typer.Option(help="Tab in front, such as Errors.")] = None,
    timeline: Annotated[str | None, typer.Option(help="Active timeline, such as load.")] = None,
    at: Annotated[int, typer.Option(min=0, help="Place on the timeline.")] = 0,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1600x1000",
) -> None:
    """Render the newest recording of a run without a screen."""
    from testbench.views.recording import viewer

    file = viewer.shot(folder, out, size=size, tab=tab, timeline=timeline, at=at)
    console.print(f"{out}: {file}", soft_wrap=True)


def main() -> None:
    """Entry point of the command."""
    sys.exit(command.run(app))
