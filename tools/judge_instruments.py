"""Judge three dial gauges against a laser tracker: true arms of several kinds, 12 planned places.

python tools/judge_instruments.py runs/judged_instruments.jsonl --seed 880001 --seeds 100

The places are planned once for the arm's folder, by the criterion I over the workspace: 12 for the tracker,
and 12 for the gauges, chosen together with their markers and directions. `--uncertainty` and `--planned-um`
are the uncertainty of the prior and the noise of a gauge that the plans count with. Every true arm is then
loaded there and read by a tracker of 50 um and by three gauges of 5 um, each half a degree off its direction.
Both readings are fitted by the default with the same wrong prior. Readings are made from the contact,
`plant.tracker`. An arm is a line of JSON in the first file; the judge may be stopped and started again.
`--seeds 0` prints the tables alone. `--alike` tilts the faces of a marker alike in all places, which the fit
does not know.
"""

import json
import sys
from argparse import ArgumentParser
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from judge_arms import lines
from threadpoolctl import threadpool_limits

from testbench.design.criteria import criterion_by_name
from testbench.design.exchange import Gauges, choose_poses_and_gauges, gauge_rows, greedy_plan
from testbench.design.planning import candidate_set
from testbench.design.rows import MeasurementSetup, PlanSpecification, Tasks, workspace_rows
from testbench.errors import BenchError
from testbench.identify.estimate import deflections, score
from testbench.identify.prior import cad_prior, scale_by_prior
from testbench.model.load import weight
from testbench.model.structure import all153
from testbench.plant.tracker import Gauge, IsotropicTracker
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.report.schema import TRUE_ARM_LABELS
from testbench.runs.rows import trial_rng
from testbench.runs.spread import MIN_PERCENTILE_TRIALS
from testbench.studies.campaign.trial import cover, worst_tenth
from testbench.workflows.campaign import (
    Scenario,
    measure_markers,
    poses_with_weight,
    read_instruments,
    true_cell,
)
from testbench.workflows.cell import build_cell, clear_poses
from testbench.workflows.instruments import Mounted
from testbench.workflows.models import ALL_UNKNOWNS, named_models, with_priors, wrong_prior

ARM, PLACES, CANDIDATES, WORKSPACE = "kr500_l480", 12, 400, 50
KINDS = (
    f"{FAMILY_NAME} cast off_40 coupled following_20 following_50 following_all tied_joints tied_all "
    "slipping bearings stiffer_10 stiffer_30 stiffer_100"
).split()
WORDS = {**TRUE_ARM_LABELS, FAMILY_NAME: "family of six kinds"}
TRACKER, GAUGE = IsotropicTracker(50e-6), Gauge()


def plan(cell, scenario, uncertainty, sigma):
    """Plan the places of the tracker and of the gauges, and their directions there.

    The plans count with the prior's uncertainty [1] and a gauge's sigma [m]; places are (poses, n) [rad, m].
    """
    rng = trial_rng(0, 5)
    hung = weight(cell.vjm, scenario.mass)
    around = clear_poses(cell, scenario.workspace, 200, rng)
    scaling = scale_by_prior(cad_prior(cell.arm), cell.vjm, all153(cell.arm))
    spec = PlanSpecification(
        MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, TRACKER.sigma),
        (hung,),
        Tasks(around, hung),
        around,
        uncertainty,
        PLACES,
    )
    found = candidate_set(spec, clear_poses(cell, scenario.station, CANDIDATES, rng))
    criterion = criterion_by_name("I", found.problem, workspace_rows(spec))
    by_tracker = found.q[greedy_plan(found.problem, criterion, found.problem.rows, PLACES)]
    gauges = Gauges(len(cell.arm.markers), sigma, GAUGE.tilt_sigma)
    rows = gauge_rows(spec, found.q, np.zeros(len(found.q), dtype=int), gauges, found.problem.lift)
    chosen = choose_poses_and_gauges(rows, found.problem, criterion, gauges, PLACES)
    direction = np.zeros((PLACES, len(cell.arm.markers), 3))
    direction[np.arange(PLACES)[:, None], chosen.marker] = np.eye(3)[chosen.axis]
    return by_tracker, found.q[chosen.pose_index], direction


def judge(cell, scenario, places, kind, seed, alike):
    """Errors and coverage of both instruments on one true arm, as a line."""
    by_tracker, by_gauges, direction = places
    true = true_cell(cell, true_arm_of_seed(kind, seed), seed)
    around = clear_poses(cell, scenario.workspace, WORKSPACE, trial_rng(seed, 0))
    everywhere = poses_with_weight(cell, around, np.arange(WORKSPACE) + 1, scenario.mass)
    truth = measure_markers(true, scenario, everywhere)
    [default] = with_priors(cell.arm, named_models(cell, (ALL_UNKNOWNS,)), wrong_prior(cell, seed))
    tilts = trial_rng(seed, 9)
    gauges = []
    for k, marker in enumerate(cell.arm.markers):
        own = direction[:, k]
        gauges.append(Mounted(replace(GAUGE, constant_tilt=alike), marker, own))
    row = {"kind": kind, "seed": seed}
    for name, mounted, q in (("tracker", [Mounted(TRACKER)], by_tracker), ("gauges", gauges, by_gauges)):
        loaded = poses_with_weight(cell, q, np.arange(PLACES) + 1, scenario.mass)
        data = read_instruments(true, "nonlinear", loaded, mounted, tilts)
        start = process_time()
        found = default.estimator(cell.vjm, default.structure, data)
        covered = cover(cell, found, truth)
        row |= {
            name: 1e3 * score(deflections(cell.vjm, found, truth), truth.deflection).rms,
            f"{name}_covered": covered.covered_percent,
            f"{name}_half": covered.half_mm,
            f"{name}_lost": int((~data.is_measured).sum()),
            f"{name}_seconds": process_time() - start,
        }
    return row


def run(file, kinds, seeds, asked):
    """Judge what the file lacks, seed by seed, so that all kinds have as many arms whenever it stops."""
    known = {(row["kind"], row["seed"]) for row in lines(file)}
    wanted = [(kind, seed) for seed in seeds for kind in kinds if (kind, seed) not in known]
    if not wanted:
        return
    cell, scenario = build_cell(ARM), Scenario(arm=ARM)
    places = plan(cell, scenario, asked.uncertainty, 1e-6 * asked.planned_um)
    for kind, seed in wanted:
        try:
            row = judge(cell, scenario, places, kind, seed, asked.alike)
        except BenchError as error:
            row = {"kind": kind, "seed": seed, "refused": str(error)}
        with file.open("a") as out:
            out.write(json.dumps(row) + "\n")


def tables(rows):
    """A table by kind of true arm: errors, their ratio, and coverage."""
    yield "| true arms | n | tracker, mm | gauges, mm | ratio on an arm, median | ratio of medians "
    yield "| tracker covers, % | worst tenth, % | gauges cover, % | worst tenth, % |\n"
    yield f"| --- |{' ---: |' * 9}\n"
    judged = [row for row in rows if "gauges" in row]
    for kind in [*(kind for kind in KINDS if any(row["kind"] == kind for row in judged)), "all"]:
        own = [row for row in judged if kind in (row["kind"], "all")]
        tracker, gauges, covered, other = (
            np.array([row[key] for row in own])
            for key in ("tracker", "gauges", "gauges_covered", "tracker_covered")
        )
        cells = [
            WORDS.get(kind, kind),
            len(own),
            spread(tracker, 3),
            spread(gauges, 3),
            spread(gauges / tracker, 2),
            f"{np.median(gauges) / np.median(tracker):.2f}",
            f"{other.mean():.1f}",
            f"{worst_tenth(other):.1f}",
            f"{covered.mean():.1f}",
            f"{worst_tenth(covered):.1f}",
        ]
        yield f"| {' | '.join(map(str, cells))} |\n"
    refused = [f"{row['kind']} {row['seed']}: {row['refused']}" for row in rows if "refused" in row]
    yield f"\nRefused: {', '.join(refused) or 'none'}.\n"


def spread(values, decimals):
    """The median with the 5th and 95th percentile; with the ends where there are few arms."""
    ends = (0, 0.5, 1) if len(values) < MIN_PERCENTILE_TRIALS else (0.05, 0.5, 0.95)
    low, middle, high = (f"{x:.{decimals}f}" for x in np.quantile(values, ends))
    return f"{middle} ({low} to {high})"


def main():
    """Judge, and print the tables."""
    flags = ArgumentParser(description=__doc__)
    flags.add_argument("files", type=Path, nargs="+", help="lines go to the first; tables are of all")
    flags.add_argument("--seed", type=int, default=880001, help="first seed")
    flags.add_argument("--seeds", type=int, default=100, help="arms of each kind; 0 for tables alone")
    flags.add_argument("--kind", action="append", choices=KINDS, help="again for more; all if none")
    flags.add_argument("--uncertainty", type=float, default=0.3, help="of the prior, in the plans [1]")
    flags.add_argument("--planned-um", type=float, default=5.0, help="noise of a gauge in the plan, um")
    flags.add_argument("--alike", action="store_true", help="faces are tilted alike in all places")
    asked = flags.parse_args()
    with threadpool_limits(1):
        seeds = range(asked.seed, asked.seed + asked.seeds)
        run(asked.files[0], asked.kind or KINDS, seeds, asked)
    sys.stdout.writelines(tables([row for file in asked.files for row in lines(file)]))


if __name__ == "__main__":
    main()
