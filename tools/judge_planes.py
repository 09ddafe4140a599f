"""Judge plane faces against a laser tracker in absolute calibration: true arms of several kinds, 60 poses.

    python tools/judge_planes.py runs/judged_planes.jsonl --seed 920001 --seeds 20

Every true arm has typical errors of geometry, and its folder has wrong compliances. In 60 poses that touch
three faces it is read without load and under 460 kg: by a tracker of 50 um, by a probe that reads its height
over the face to 10 um, and by touches, for which the joints are moved until the height is 0. In 60 other
poses it touches four faces of one box, whose angles and distances are known; the box as a whole is off its
stated place by 2 mm and half a degree. All are fitted by geometry, joint springs and links. Errors are those
of 150 poses that were never read, under own weight and under load, after frame and target were fitted to 30
others. An arm and instrument is a line of JSON in the file; the judge may be stopped and started again.
`--seeds 0` prints the table alone.
"""

import json
import sys
from argparse import ArgumentParser
from dataclasses import replace
from pathlib import Path

import numpy as np
from judge_arms import lines
from judge_instruments import spread
from threadpoolctl import threadpool_limits

from testbench.data.dataset import select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.fit import SELECTABLE_ERRORS, CalibrationOptions, calibrate
from testbench.plant.disturbance import TYPICAL_DISTURBANCES, Disturbances
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed
from testbench.runs.rows import trial_rng
from testbench.workflows.absolute import position_errors
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_distances, simulate_series
from testbench.workflows.campaign import true_cell
from testbench.workflows.cell import build_cell
from testbench.workflows.instruments import mounted, moved_along_normal, poses_on_planes
from testbench.workflows.models import wrong_prior

ARM, POSES, MASS = "kr500_l480", 60, 460.0
FACES = ("plane:P1:z:1.9,0.3,0.6", "plane:P1:-x:2.3,0,1.4", "plane:P1:-y:1.5,1.2,1.4")
BOX = tuple(f"{face}:box" for face in (*FACES, "plane:P1:y:1.5,-1.2,1.4"))
CHECKED, PLACED = 180, 30  #: Poses that are never fitted, and those of them that give frame and target.
OPTIONS = CalibrationOptions(excluded_errors=frozenset(SELECTABLE_ERRORS) - {"joint springs", "links"})
CAMPAIGN = AbsoluteCampaign(
    poses=POSES,
    masses=(0.0, MASS),
    disturbances=Disturbances(own_weight=True, geometry=TYPICAL_DISTURBANCES.geometry),
)
LOADS = {"weight": "own weight", "loaded": f"under {MASS:g} kg"}


def by_tracker(cell, true, seed):
    """Read positions in the poses on the faces."""
    q = poses_on_planes(cell, [*map(mounted, FACES)], POSES, trial_rng(seed, 4))
    return simulate_series(true, CAMPAIGN, seed, q)[0]


def by_heights(cell, true, seed):
    """Read heights over the faces, the arm commanded to touch them."""
    faces = [*map(mounted, FACES)]
    q = poses_on_planes(cell, faces, POSES, trial_rng(seed, 4))
    return simulate_distances(true, CAMPAIGN, faces, seed, q)[0]


def by_touches(cell, true, seed):
    """Touch the faces, each off its stated place."""
    faces = [*map(mounted, FACES)]
    return touches(true, faces, seed, poses_on_planes(cell, faces, POSES, trial_rng(seed, 4)))


def in_a_box(cell, true, seed):
    """Touch four faces of one box, which is known."""
    faces = [*map(mounted, BOX)]
    return touches(true, faces, seed, poses_on_planes(cell, faces, POSES, trial_rng(seed, 7)))


KINDS = {
    "tracker": ("tracker, 50 um", by_tracker),
    "heights": ("heights over three faces, 10 um", by_heights),
    "touches": ("touches of three faces, 10 um", by_touches),
    "box": ("touches of a box, 10 um", in_a_box),
}


def touches(cell, faces, seed, q):
    """Move the joints of every row until the true arm touches, and read noise about zero there."""
    quiet = {"sigma": 1e-9, "flatness_sigma": 0.0, "max_height": 1.0}  # the joints move until it touches
    exact = [replace(own, instrument=replace(own.instrument, **quiet)) for own in faces]
    parts = []
    for mass in CAMPAIGN.masses:
        campaign, at = CAMPAIGN.model_copy(update={"masses": (mass,)}), q.copy()
        for _ in range(4):  # of which each leaves about a hundredth of the height
            found, _ = simulate_distances(cell, campaign, exact, seed, at)
            for own, series in zip(exact, found, strict=True):
                rows = series.pose_id - 1
                at[rows] = moved_along_normal(cell, own, at[rows], series.distance[:, 0])
        parts.append(found)
    rng = trial_rng(seed, 6)
    read = []
    for own, both in zip(faces, zip(*parts, strict=True), strict=True):
        sigma = float(np.hypot(own.instrument.sigma, own.instrument.flatness_sigma))
        for one in both:
            noise = sigma * rng.standard_normal(one.distance.shape)
            there = np.abs(one.distance[:, 0]) < 1e-7  # a hundredth of the noise; others are never reached
            read.append(select_rows(replace(one, distance=noise, sigma=sigma), there))
    return read


def judge(cell, seed, kind):
    """Calibrate one true arm by one instrument, and score it."""
    true = true_cell(cell, true_arm_of_seed(FAMILY_NAME, seed), seed)
    series = KINDS[kind][1](cell, true, seed)
    found = calibrate(cell.vjm, series, wrong_prior(cell, seed), OPTIONS).model()
    unseen = CAMPAIGN.model_copy(update={"poses": CHECKED, "noise": False})
    (check,), _ = simulate_series(true, unseen, seed)
    check = replace(check, name="check", frame="check", mount="check")
    row = {"seed": seed, "kind": kind, "numbers": sum(one.n_equations for one in series)}
    for load, of in (("weight", 0.0), ("loaded", 1.0)):
        rows = np.flatnonzero(check.wrench.any(axis=1) == of)
        errors = position_errors(found, [select_rows(check, rows)], PLACED)
        row |= {load: errors.rms_mm, f"{load}_covered": 100 * errors.coverage_95}
    return row


def run(file, seeds):
    """Judge what the file lacks."""
    known, cell = {(row["seed"], row["kind"]) for row in lines(file)}, build_cell(ARM)
    for seed, kind in ((seed, kind) for seed in seeds for kind in KINDS):
        if (seed, kind) in known:
            continue
        try:
            row = judge(cell, seed, kind)
        except BenchError as error:
            row = {"seed": seed, "kind": kind, "refused": str(error)}
        with file.open("a") as out:
            out.write(json.dumps(row) + "\n")


def table(rows):
    """Errors by instrument and load, their ratio to the tracker's on the same arm, and coverage."""
    yield "| read by | numbers | load | RMS error, mm | over the tracker's | better | covered, % |\n"
    yield "| --- | ---: | --- | --- | --- | ---: | ---: |\n"
    judged = {(row["seed"], row["kind"]): row for row in rows if "loaded" in row}
    for kind, (words, _) in KINDS.items():
        own = [row for (seed, of), row in judged.items() if of == kind and (seed, "tracker") in judged]
        for load, under in LOADS.items() if own else ():
            errors = np.array([row[load] for row in own])
            ratio = errors / [judged[row["seed"], "tracker"][load] for row in own]
            cells = [
                words,
                f"{np.median([row['numbers'] for row in own]):.0f}",
                under,
                spread(errors, 3),
                spread(ratio, 2),
                f"{(ratio < 1).sum()} of {len(own)}",
                f"{np.mean([row[f'{load}_covered'] for row in own]):.1f}",
            ]
            yield f"| {' | '.join(cells)} |\n"
    refused = [f"{row['seed']} {row['kind']}: {row['refused']}" for row in rows if "refused" in row]
    yield f"\nRefused: {', '.join(refused) or 'none'}.\n"


def main():
    """Judge, and print the table."""
    flags = ArgumentParser(description=__doc__)
    flags.add_argument("file", type=Path, help="one line per arm and instrument")
    flags.add_argument("--seed", type=int, default=920001, help="first seed")
    flags.add_argument("--seeds", type=int, default=20, help="number of arms; 0 for the table alone")
    asked = flags.parse_args()
    with threadpool_limits(1):
        run(asked.file, range(asked.seed, asked.seed + asked.seeds))
    sys.stdout.writelines(table(list(lines(asked.file))))


if __name__ == "__main__":
    main()
