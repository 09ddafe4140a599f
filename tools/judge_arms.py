"""Judge the default on true arms that no model contains: the tables of docs/judged.

python tools/judge_arms.py runs/judged.jsonl --seed 780001 --seeds 100

Every arm is measured in 8 poses under a weight, with 50 um of noise, and fitted with a wrong prior. Rivals
are Joints-only, the default without its cone (least squares with the same prior), and, without a
prior, GCO and ridge regression on MGCO56. An arm is a line of JSON in the first file. The judge may be
stopped at any time: started again, it goes on behind the last whole line. Two judges share the cores with a
file each and different kinds; tables are of all files together. `--seeds 0` prints the tables alone.

Every line holds the coverage at several scales of the half widths, and the errors of the default for each
answer of the test of poses left out, so that tables of other scales and thresholds need no fit.
"""

import csv
import json
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.identify import average
from testbench.identify.estimate import deflections, score
from testbench.identify.method import gco
from testbench.identify.posterior import intervals
from testbench.identify.trace import SELECTION_CONFIDENCE, mean_and_standard_error
from testbench.model.structure import template56
from testbench.plant.true_arms import FAMILY_NAME, true_arm_of_seed, true_arms
from testbench.report import markdown
from testbench.report.schema import TRUE_ARM_LABELS
from testbench.runs.rows import trial_rng
from testbench.runs.spread import median_interval
from testbench.studies.campaign.model_error import ALL, disturbances, disturbed
from testbench.studies.campaign.trial import covers, reread, worst_tenth
from testbench.studies.intervals import ridge
from testbench.studies.study import without_cone
from testbench.workflows.campaign import Scenario, draw_poses, simulate_at, true_cell
from testbench.workflows.cell import build_cell
from testbench.workflows.models import ALL_UNKNOWNS, JOINTS_ONLY, named_models, with_priors, wrong_prior

ARM, SIGMA, POSES = "kr500_l480", 50e-6, 50  #: The arm; noise of a reading [m]; poses of the workspace.
DISTURBED = "disturbed"
KINDS = (
    f"{FAMILY_NAME} {DISTURBED} cast off_40 coupled following_20 following_50 following_all tied_joints "
    "tied_all slipping stiffer_10 stiffer_30 stiffer_100"
).split()
WORDS = {**TRUE_ARM_LABELS, FAMILY_NAME: "family of six kinds", DISTURBED: "family, all disturbances"}
KINDS += true_arms.added  # those of installed packages
CLEARLY = 1.05  #: Ratio of errors from which on an arm counts as lost.
DRAWS = 4000  #: Of a bootstrap.
SCALES = np.linspace(0.6, 1.4, 17)  #: Factors on half widths whose coverage every line has.
SHOWN = (2, 4, 6, 8, 12)  #: Those of them that the table has.
MEANS, WORST = (92.0, 97.0), 80.0  #: Where the mean coverage should be, and the least of the worst tenth [%].
ANSWERS = ("passed", "unsure", "failed")
SURE = float(stdtrit(7, SELECTION_CONFIDENCE))  #: Of eight poses, how sure links have to be.
THRESHOLDS = (-np.inf, 1.0, SURE, 3.0, 4.0, np.inf)
STIFF = ("stiffer_10", "stiffer_30", "stiffer_100")


def measured(cell, poses, kind, seed):
    """Readings of a true arm, and what it does in the poses of the workspace."""
    scenario = Scenario(arm=ARM, sigma=SIGMA, workspace_poses=POSES)
    true = true_cell(cell, true_arm_of_seed(FAMILY_NAME if kind == DISTURBED else kind, seed), seed)
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
    [joints] = named_models(cell, (JOINTS_ONLY,))
    plain = [*named_models(cell, (ALL_UNKNOWNS,)), without_cone(cell)]
    default, squares = with_priors(cell.arm, plain, prior)
    rivals = {"joints": fit(cell, joints, readings), "squares": fit(cell, squares, readings)}
    rivals |= {name: own(cell.vjm, template, readings) for name, own in (("gco", gco), ("ridge", ridge))}
    errors = {name: error(cell, own, truth) for name, own in rivals.items()}
    return {"kind": kind, "seed": seed, **of_default(cell, default, readings, truth), **errors}


def fit(cell, model, readings):
    """Estimate of a model."""
    return model.estimator(cell.vjm, model.structure, readings)


def error(cell, estimate, truth):
    """RMS error over the workspace [mm]."""
    return 1e3 * score(deflections(cell.vjm, estimate, truth), truth.deflection).rms


def of_default(cell, default, readings, truth):
    """Error and coverage of the default, what it weighs, and how it decided: columns of a line."""
    with watched() as steps:
        own = fit(cell, default, readings)
    found = intervals(cell.vjm, own, truth)
    half = (found.upper - found.lower) / 2
    covered = covers(found.centre, half, truth.deflection)
    return {
        "default": error(cell, own, truth),
        "covered": covered.covered_percent,
        "half": covered.half_mm,
        "ideal": covered.ideal_mm,
        "covered_at": covered_at(found.centre, half, truth.deflection),
        "ties": own.averaged_models.joint_couplings_weight if own.averaged_models else 0.0,
        **decision(cell, truth, *steps[0]),
    }


def covered_at(centre, half, true):
    """Coverage of intervals whose half widths are multiplied by each of `SCALES` [%]."""
    inside = np.abs(centre - true)[..., None] <= half[..., None] * SCALES
    return (100 * inside.reshape(-1, len(SCALES)).mean(axis=0)).tolist()


@contextmanager
def watched():
    """Record what the last step of the default's fit is given, which weighs joints alone."""
    steps, last = [], average.average_with_joints_only

    def watch(*given):
        steps.append(given)
        return last(*given)

    with patch.object(average, "average_with_joints_only", watch):
        yield steps


def decision(cell, truth, regression, constraint, prior, mean, _):
    """What poses left out and the evidence say of links, and errors by each answer [mm]: columns of a line.

    The answers are those of `average.joints_only_weight`: links passed the test, links change and are not
    surely worse, links failed.
    """
    rivals = average.links_versus_joints_only(regression, mean, prior)
    changes = rivals is not None and rivals.most_probable.regression.pose_variation is not None
    weights = (
        (average.MIN_JOINTS_ONLY_WEIGHT, average.JOINTS_ONLY_WEIGHT_IF_UNSURE, 1.0)
        if changes
        else (0.0, 1.0, 1.0)
    )
    errors = {
        w: error(cell, average.average_with_joints_only(regression, constraint, prior, mean, w), truth)
        for w in {*weights}
    }
    gain = None
    if rivals is not None:
        links, joints = (np.log(own) for own in rivals.held_out_errors)
        gain = mean_and_standard_error(joints - links)  # mean and standard error over poses
    return {
        **dict(zip(ANSWERS, (errors[w] for w in weights), strict=True)),
        "gain": gain,
        "evidence": rivals and rivals.log_bayes_factor,
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
    """Tables by name, their headings first: rivals, GCO without a prior, scaled intervals, thresholds."""
    kinds = [kind for kind in KINDS if any(row["kind"] == kind and "default" in row for row in rows)]
    own = {kind: [row for row in rows if row["kind"] == kind and "default" in row] for kind in kinds}
    scales = [f"{SCALES[k]:.1f}" for k in SHOWN]
    return {
        "default": table(
            "true arms|n|default, mm|Joints-only, mm|loses to it|LS with the prior, mm|loses to it|covered, %"
            "|worst tenth, %|half width over the narrowest".split("|"),
            [beside(kind, own[kind]) for kind in kinds],
        ),
        "without_prior": table(
            "true arms|n|GCO, mm|Joints-only, mm|ridge, mm|GCO over the better (95 %)".split("|"),
            [without_prior(kind, own[kind]) for kind in kinds],
        ),
        "scales": table(["true arms", "n", *scales, "both bars met"], scaled(own)),
        "thresholds": table(
            "links count above|loses, links 10, 30, 100 times stiffer|loses, worst other kind"
            "|over 5 % worse than the default|over 5 % better|largest rise of a median".split("|"),
            [threshold(own, least) for least in THRESHOLDS] if own else [],
        ),
    }


def table(heads, rows):
    """Headings, and rows of cells as texts."""
    return [heads, *([str(cell) for cell in row] for row in rows)]


def beside(kind, rows):
    """A row of the first table."""
    default, joints, squares, covered = (
        np.array([row[key] for row in rows]) for key in ("default", "joints", "squares", "covered")
    )
    wide = np.median([row["half"] / row["ideal"] for row in rows])
    return [
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


def scaled(own):
    """Rows of the third table: mean and worst tenth of the coverage where all half widths are scaled."""
    common = np.ones(len(SCALES), bool)
    for kind, rows in own.items():
        covered = np.array([row["covered_at"] for row in rows])
        means, worst = covered.mean(axis=0), np.apply_along_axis(worst_tenth, 0, covered)
        good = (means >= MEANS[0]) & (means <= MEANS[1]) & (worst >= WORST)
        common &= good
        cells = [f"{means[k]:.1f} / {worst[k]:.1f}" for k in SHOWN]
        yield [WORDS.get(kind, kind), len(rows), *cells, extent(good)]
    yield ["all of them at once", sum(map(len, own.values())), *[""] * len(SHOWN), extent(common)]


def extent(good):
    """The least and the largest of some scales."""
    some = SCALES[good]
    return f"{some[0]:.2f} to {some[-1]:.2f}" if len(some) else "none"


def threshold(own, least):
    """A row of the fourth table: what the default would lose if links had to be surer, or less sure."""
    by = {kind: np.array([decided(row, least) for row in rows]) for kind, rows in own.items()}
    now = {kind: np.array([row["default"] for row in rows]) for kind, rows in own.items()}
    lost = {kind: by[kind] > CLEARLY * np.array([row["joints"] for row in own[kind]]) for kind in own}
    rise = {kind: np.median(by[kind]) / np.median(now[kind]) - 1 for kind in own}
    moved = np.concatenate([by[kind] / now[kind] for kind in own])

    def of(kinds):
        return ", ".join(f"{lost[kind].sum()} of {len(lost[kind])}" for kind in kinds)

    stiff = [kind for kind in own if kind in STIFF]
    others = sorted(own.keys() - {*stiff}, key=lambda kind: lost[kind].mean())
    worst = max(own, key=rise.get)
    called = {-np.inf: "always", np.inf: "never where asked"}.get(least, f"{least:.1f}")
    return [
        called + (" (default)" if least == SURE else ""),
        of(stiff),
        of(others[-1:]),
        f"{(moved > CLEARLY).sum()} of {len(moved)}",
        f"{(moved < 1 / CLEARLY).sum()} of {len(moved)}",
        f"{100 * rise[worst]:.0f} %, {WORDS.get(worst, worst)}" if rise[worst] > 0 else "none",
    ]


def decided(row, least):
    """Error [mm] if links count only above so many standard errors, where the evidence leaves doubt."""
    if row["gain"] is None or not (row["changes"] or row["evidence"] <= average.DECISIVE_LOG_EVIDENCE):
        return row["passed"]
    gain, error_ = row["gain"]
    if gain > least * error_:
        return row["passed"]
    return row["unsure" if gain > -SURE * error_ else "failed"]


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
    medians = [f"{np.median(own):.3f}" for own in (gco_, joints, ridge_)]
    ratio = over(np.arange(len(rows)))
    return [WORDS.get(kind, kind), len(rows), *medians, f"{ratio:.2f} ({low:.2f} to {high:.2f})"]


def main():
    """Judge, and print the tables."""
    flags = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    flags.add_argument("files", type=Path, nargs="+", help="lines go to the first; tables are of all")
    flags.add_argument("--seed", type=int, default=780001, help="first seed")
    flags.add_argument("--seeds", type=int, default=100, help="arms of each kind; 0 for tables alone")
    flags.add_argument("--kind", action="append", choices=KINDS, help="again for more; all if none")
    flags.add_argument("--into", type=Path, help="folder for the tables as CSV, such as docs/judged")
    asked = flags.parse_args()
    with threadpool_limits(1):
        run(asked.files[0], asked.kind or KINDS, range(asked.seed, asked.seed + asked.seeds))
    rows = [row for file in asked.files for row in lines(file)]
    found = tables(rows)
    refused = [f"{row['kind']} {row['seed']}" for row in rows if "refused" in row]
    shown = (markdown.lines(heads, body) for heads, *body in found.values())
    print(*shown, f"Refused: {', '.join(refused) or 'none'}.", sep="\n\n")
    if asked.into:
        write(found, asked.into)


def write(found, folder):
    """Write each table as NAME.csv."""
    for name, table in found.items():
        with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(table)


if __name__ == "__main__":
    main()
