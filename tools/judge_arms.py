"""Judge the default on true arms that no model contains: the tables of docs/limits.md.

python tools/judge_arms.py runs/judged.jsonl --seed 780001 --seeds 100

Every arm is measured in 8 poses under a weight, with 50 um of noise, and fitted with a wrong prior. Rivals
are joint stiffness only, the default without its cone (least squares with the same prior), and, without a
prior, GCO and ridge regression on MGCO56. An arm is a line of JSON in the first file. The judge may be
stopped at any time: started again, it goes on behind the last whole line. Two judges share the cores with a
file each and different kinds; tables are of all files together. `--seeds 0` prints the tables alone.
"""

import json
import sys
from argparse import ArgumentParser
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from time import process_time
from unittest.mock import patch

import numpy as np
from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.identify import average, gco, intervals
from testbench.identify.estimate import deflections, score
from testbench.identify.trace import paired
from testbench.model.structure import template56
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import CALLED, FAMILY, true_arm_of_seed, true_arms
from testbench.runs.spread import median_interval
from testbench.studies.campaign.disturbed import ALL, disturbances, disturbed
from testbench.studies.campaign.trial import covers, reread, worst_tenth
from testbench.studies.estimators.shrunk import ridge
from testbench.studies.study import without_cone
from testbench.workflows.cell import Scenario, build_cell, draw_poses, simulate_at, true_cell
from testbench.workflows.model_selection import ALL_UNKNOWNS, with_priors
from testbench.workflows.models import JOINTS, named_models
from testbench.workflows.perturbed_prior import wrong_prior

ARM, SIGMA, POSES = "kr500_l480", 50e-6, 50  #: The arm; noise of a reading [m]; poses of the workspace.
DISTURBED = "disturbed"
KINDS = (
    f"{FAMILY} {DISTURBED} cast off_40 coupled following_20 following_50 following_all tied_joints tied_all "
    "slipping stiffer_10 stiffer_30 stiffer_100"
).split()
WORDS = {**CALLED, FAMILY: "family of six kinds", DISTURBED: "family, all disturbances"}
KINDS += true_arms.added  # those of installed packages
CLEARLY = 1.05  #: Ratio of errors from which on an arm counts as lost.
DRAWS = 4000  #: Of a bootstrap.
SCALES = np.linspace(0.6, 1.4, 17)  #: Factors on half widths whose coverage every line has.


def measured(cell, poses, kind, seed):
    """Readings of a true arm, and what it does in the poses of the workspace."""
    scenario = Scenario(arm=ARM, sigma=SIGMA, workspace_poses=POSES)
    true = true_cell(cell, true_arm_of_seed(FAMILY if kind == DISTURBED else kind, seed), seed)
    if kind != DISTURBED:
        campaign = simulate_at(true, scenario, seed, poses)
        return campaign.identification, campaign.truth
    quiet = scenario.model_copy(update={"noise": False, "truth": "linear"})
    clean, truth = disturbed(true, simulate_at(true, quiet, seed, poses), disturbances(1.0)[ALL], seed)
    return reread(clean, SIGMA, trial_rng(seed, 1)), truth


def judge(cell, poses, kind, seed):
    """Errors of the default and of its rivals [mm], and how well its intervals cover, as a line."""
    readings, truth = measured(cell, poses, kind, seed)
    prior, template = wrong_prior(cell, seed), template56(cell.arm)
    [joints] = named_models(cell, (JOINTS,))
    plain = [*named_models(cell, (ALL_UNKNOWNS,)), without_cone(cell)]
    default, squares = with_priors(cell.arm, plain, prior)
    others = {"joints": fit(cell, joints, readings), "squares": fit(cell, squares, readings)}
    others |= {name: own(cell.vjm, template, readings) for name, own in (("gco", gco), ("ridge", ridge))}
    errors = {name: error(cell, own, truth) for name, own in others.items()}
    return {"kind": kind, "seed": seed, **of_default(cell, default, readings, truth), **errors}


def fit(cell, model, readings):
    """Estimate of a model."""
    return model.estimator(cell.vjm, model.structure, readings)


def error(cell, estimate, truth):
    """RMS error over the workspace [mm]."""
    return 1e3 * score(deflections(cell.vjm, estimate, truth), truth.deflection).rms


def of_default(cell, default, readings, truth):
    """Error and coverage of the default, and what it weighs: columns of a line."""
    start = process_time()
    with watched() as seen:
        own = fit(cell, default, readings)
    seconds, found = process_time() - start, intervals(cell.vjm, own, truth)
    half = (found.upper - found.lower) / 2
    covered = covers(found.centre, half, truth.deflection)
    return {
        "default": error(cell, own, truth),
        "covered": covered.covered_percent,
        "half": covered.half_mm,
        "ideal": covered.ideal_mm,
        "covered_at": covered_at(found.centre, half, truth.deflection),
        "rigid": own.average.weight if own.average else 0.0,
        "ties": own.average.ties_weight if own.average else 0.0,
        "seconds": seconds,
        **candidates(cell, truth, *seen[0]),
    }


def covered_at(centre, half, true):
    """Coverage of intervals whose half widths are multiplied by each of `SCALES` [%]."""
    inside = np.abs(centre - true)[..., None] <= half[..., None] * SCALES
    return (100 * inside.reshape(-1, len(SCALES)).mean(axis=0)).tolist()


@contextmanager
def watched():
    """Record what the default passes to the last step of its fit, in which joints alone get their weight."""
    seen, last = [], average.steadied

    def watch(*given):
        seen.append(given)
        return last(*given)

    with patch.object(average, "steadied", watch):
        yield seen


def candidates(cell, truth, regression, constraint, prior, mean, _):
    """Errors of the fit at every weight of joints alone [mm], and what decides: columns of a line.

    The weights are those of `average.links_or_joints`: links passed the test of poses left out, links change
    and are not surely worse, links failed it.
    """
    rivals = average.links_and_joints(regression, mean, prior)
    gain = (0.0, 0.0)
    if rivals is not None:
        links, joints = (np.log(own) for own in rivals.errors)
        gain = paired(joints - links)
    changes = rivals is not None and rivals.likeliest.regression.wander is not None
    weights = (average.RIGID, average.RIGID_IF_UNSURE, 1.0) if changes else (0.0, 1.0, 1.0)
    tried = {w: average.steadied(regression, constraint, prior, mean, w) for w in set(weights)}
    errors = {w: error(cell, own, truth) for w, own in tried.items()}
    return {
        "passed": errors[weights[0]],
        "unsure": errors[weights[1]],
        "failed": errors[weights[2]],
        "gain": gain,
        "evidence": rivals.log_evidence if rivals is not None else None,
        "changes": changes,
    }


def run(file, kinds, seeds):
    """Judge what the file lacks, seed by seed, so that all kinds have as many arms whenever it stops."""
    known = {(row["kind"], row["seed"]) for row in lines(file)}
    whole = file.read_bytes() if file.exists() else b""
    cell = build_cell(ARM)
    with file.open("r+b" if whole else "wb") as out:
        out.truncate(whole.rfind(b"\n") + 1)  # a line that was cut short is judged anew
        out.seek(0, 2)
        for seed in seeds:
            wanted = [kind for kind in kinds if (kind, seed) not in known]
            poses = draw_poses(cell, Scenario(arm=ARM, workspace_poses=POSES), seed) if wanted else None
            for kind in wanted:
                try:
                    row = judge(cell, poses, kind, seed)
                except BenchError as error:
                    row = {"kind": kind, "seed": seed, "refused": str(error)}
                out.write(json.dumps(row).encode() + b"\n")
                out.flush()


def lines(file):
    """Whole lines of a file, as dictionaries."""
    text = file.read_text() if file.exists() else ""
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


def tables(rows):
    """The table of the default beside its rivals, then that of GCO without a prior."""
    kinds = [kind for kind in KINDS if any(row["kind"] == kind and "default" in row for row in rows)]
    own = {kind: [row for row in rows if row["kind"] == kind and "default" in row] for kind in kinds}
    yield "| true arms | n | default, mm | Joints-only, mm | loses | least squares with the prior, mm "
    yield "| loses | covered, % | worst tenth, % | half width over the narrowest |\n"
    yield "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
    yield from (beside(kind, own[kind]) for kind in kinds)
    yield "\n| true arms | n | GCO, mm | Joints-only, mm | ridge, mm | GCO over the better (95 %) |\n"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |\n"
    yield from (without_prior(kind, own[kind]) for kind in kinds)
    refused = [f"{row['kind']} {row['seed']}" for row in rows if "refused" in row]
    yield f"\nRefused: {', '.join(refused) or 'none'}.\n"


def beside(kind, rows):
    """A row of the first table."""
    default, joints, squares, covered = (
        np.array([row[key] for row in rows]) for key in ("default", "joints", "squares", "covered")
    )
    wide = np.median([row["half"] / row["ideal"] for row in rows])
    cells = [
        WORDS.get(kind, kind),
        len(rows),
        middle(default),
        f"{np.median(joints):.3f}",
        int((default > CLEARLY * joints).sum()),
        f"{np.median(squares):.3f}",
        int((default > CLEARLY * squares).sum()),
        f"{covered.mean():.1f}",
        f"{worst_tenth(covered):.1f}",
        f"{wide:.2f}",
    ]
    return f"| {' | '.join(map(str, cells))} |\n"


def middle(errors):
    """The median, with its 95 % interval where there are arms enough."""
    ends = median_interval(errors)
    return f"{np.median(errors):.3f}" + (f" ({ends[0]:.3f} to {ends[1]:.3f})" if ends else "")


def without_prior(kind, rows):
    """A row of the second table: the ratio of medians, its interval by a bootstrap over the arms."""
    gco_, joints, ridge_ = (np.array([row[key] for row in rows]) for key in ("gco", "joints", "ridge"))

    def over(at):
        of = partial(np.median, axis=-1)
        return of(gco_[at]) / np.minimum(of(joints[at]), of(ridge_[at]))

    drawn = over(np.random.default_rng(0).integers(0, len(rows), (DRAWS, len(rows))))
    low, high = np.quantile(drawn, (0.025, 0.975))
    medians = " | ".join(f"{np.median(own):.3f}" for own in (gco_, joints, ridge_))
    ratio = over(np.arange(len(rows)))
    return f"| {WORDS.get(kind, kind)} | {len(rows)} | {medians} | {ratio:.2f} ({low:.2f} to {high:.2f}) |\n"


def main():
    """Judge, and print the tables."""
    flags = ArgumentParser(description=__doc__)
    flags.add_argument("files", type=Path, nargs="+", help="lines go to the first; tables are of all")
    flags.add_argument("--seed", type=int, default=780001, help="first seed")
    flags.add_argument("--seeds", type=int, default=100, help="arms of each kind; 0 for tables alone")
    flags.add_argument("--kind", action="append", choices=KINDS, help="again for more; all if none")
    asked = flags.parse_args()
    with threadpool_limits(1):
        run(asked.files[0], asked.kind or KINDS, range(asked.seed, asked.seed + asked.seeds))
    sys.stdout.writelines(tables([row for file in asked.files for row in lines(file)]))


if __name__ == "__main__":
    main()
