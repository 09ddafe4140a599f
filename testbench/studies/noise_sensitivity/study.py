"""What noise costs, by method and structure, and what better instruments are worth."""

from collections.abc import Iterator

import numpy as np

from testbench.arm.folder import find_arm
from testbench.campaign.model_selection import DEFAULT
from testbench.campaign.models import EQUAL_FIT, JOINTS
from testbench.campaign.rows import UM
from testbench.report import badge, campaigns
from testbench.report.campaigns import distinct
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import TRIAL, Row, Trials, matched
from testbench.studies.factorial import compare
from testbench.studies.factorial.compare import DUELS, ERROR, RMS
from testbench.studies.factorial.trial import FitRow
from testbench.studies.noise_sensitivity import trial
from testbench.studies.noise_sensitivity.trial import HEAVY, INSTRUMENT, NEAR, Options, Settings
from testbench.studies.rivals import SAME
from testbench.studies.study import Study
from testbench.trials.spread import middle, span
from testbench.views.figure import Figure, sweeps
from testbench.views.markdown import Markdown
from testbench.views.schema import ALIKE, Table

PARTS = {"gravity": "KR 500, 8 poses", "six_dof": "108 runs of section 5.2"}
TRACKER_UM = {"gravity": 50.0, "six_dof": 25.0}  #: Noise of the paper's trackers, sections 6 and 5.2.
JUDGED = {"gravity": "workspace", "six_dof": "check"}
CROWD = ("MLS32", EQUAL_FIT, "Clipped LS", "MGCO47", "MGCO68", "MGCO69", "MGCO147")
FILLED_CROWD = ("Joints + prior", "MGCO56 + prior", "MGCO68 + prior", "MGCO69 + prior", SAME)
"""Models without a line in the figure, where more would cover one another."""
BANDS = (JOINTS, DEFAULT)  #: Lines with their spread.
HOW = Markdown(
    "## How it was done\n\n"
    "True arms: links of tubes, as in the model; links 10, 20 and 40 % off any tube; cast links; unequal "
    "joints. The model and the prior stay those of the arm's folder. The prior is twice too soft and 30 % "
    "wrong in shape, on purpose. Its common scale is fitted to the data. ALL153 + prior learns from the "
    "readings how wrong the prior is by link and joint; the other models believe each entry to 30 %. The "
    "cost of 1 um of noise is what the largest noise adds in quadrature to the error without noise, divided "
    "by that noise. Instruments are read on the KR 500, by MGCO56 + prior. Lost targets have no weight; "
    "nothing looks for misread ones. The flat instrument reads alike wherever it stands."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by part, model and level, and by instrument."""
    parts = {part: _of_part(part, trials) for part in PARTS}
    read = trials.where(part="instrument").held()
    f = Row(
        compare.head(seeds, trials, asked.true_arm),
        truth={"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        default=DEFAULT,
        trials=Row(
            {part: len(own.values(TRIAL)) for (part,), own in trials.keep("part", TRIAL).groups("part")}
        ),
        sigmas_um=[UM * sigma for sigma in asked.sigmas],
        **{
            key: Row({part: own[key] for part, own in parts.items()})
            for key in parts["gravity"]
            if key != "badge"
        },
        instruments=compare.cells(read.where(name=INSTRUMENT), "truth", "instrument", "distance_m"),
        near_m=NEAR,
        weighted_over_flat=compare.duels(
            read, [(trial.WEIGHTED, trial.UNWEIGHTED)], "truth", "name", "distance_m", of="instrument"
        ),
        models=[
            model
            for part, own in parts.items()
            for model in compare.contract(_at_tracker(own), JUDGED[part], PARTS[part])
        ],
    )
    return Report(
        scenario=STUDY.name,
        question=Markdown("What does tracker noise cost, by method and structure?"),
        title=_title(f),
        answer=lines([_at(f, "gravity"), *compare.beside_rivals(f.gains.gravity)]),
        worst=say(
            "Worst trial at {sigma_um:g} um, {where}: {default} {default_um:.0f} um, least squares "
            "without prior {least_squares_um:.0f} um, joint stiffness only {joints_um:.0f} um.",
            f.worst.gravity,
            where=PARTS["gravity"],
            default=DEFAULT,
        ),
        claims=list(_claims(f)),
        numbers=f,
        tables=(tables := _tables(f)),
        body=[*tables, HOW],
        badge=parts["gravity"].badge,
    )


def _of_part(part: str, trials: Trials) -> Row:
    """Every model at every noise, what the default gains at that of the paper's tracker, and the largest."""
    own = trials.where(part=part).keep(TRIAL, "sigma_um", *compare.JUDGED).held()
    noises = own.values("sigma_um")
    sigma = min(noises, key=lambda level: abs(level - TRACKER_UM[part]))
    sweeps = compare.cells(_with_cost(own), "sigma_um", also=("um_per_um",))
    found = Row(sweeps=sweeps, tracker_um=sigma)
    at, models = own.where(sigma_um=sigma), _at_tracker(found)
    found["gains"], found["badge"] = (compare.gains(at, models), badge.of_models(at, models, DEFAULT, ERROR))
    rival, noisy = found.gains.least_squares.theirs, own.where(sigma_um=max(noises))
    last = campaigns.worst_trial(noisy, DEFAULT, rival, JOINTS, value=ERROR).errors
    return Row(
        found,
        worst=Row(
            sigma_um=max(noises),
            default_um=last[DEFAULT],
            least_squares_um=last[rival],
            joints_um=last[JOINTS],
        ),
        paired=compare.duels(own.pick(own["sigma_um"] > 0), DUELS, "sigma_um"),
    )


def _at_tracker(part: Row) -> list[Row]:
    """The models at the noise of the paper's tracker, a completion only where one exists."""
    return distinct([row for row in part.sweeps if row.sigma_um == part.tracker_um])


def _with_cost(trials: Trials) -> Trials:
    """With what the largest noise adds in quadrature to the error of the same trial without, per noise."""
    calm, noisy = (
        matched(trials, trials.where(sigma_um=sigma), ERROR, ("name", TRIAL))
        for sigma in (0.0, max(trials.values("sigma_um")))
    )
    added = np.sqrt(np.maximum(0, noisy**2 - calm**2)) / max(trials.values("sigma_um"))
    return trials.add(um_per_um=added)


def _title(f: Row) -> Markdown:
    """What was simulated."""
    return say(
        "Noise of {least:g} to {most:g} um a reading and axis, the same random numbers at every level: "
        "{trials.six_dof} trials of 108 runs of section 5.2, {trials.gravity} of the KR 500 in 8 poses, "
        "{trials.instrument} of several instruments. {arms} Errors are RMS, against the truth: of the KR 500 "
        "over the workspace, else in the check runs. Medians ({ends}).",
        f,
        least=f.sigmas_um[0],
        most=f.sigmas_um[-1],
        arms=compare.arms_told(f),
        ends=span(f.trials.gravity),
    )


def _at(f: Row, part: str) -> Markdown:
    """Where something holds: a part, at the noise of its tracker."""
    return say("{where}, {sigma:g} um of noise:", where=PARTS[part], sigma=f.tracker_um[part])


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield lines([_at(f, "six_dof"), *compare.beside_rivals(f.gains.six_dof)])
    here = [d for d in f.paired.gravity if d.sigma_um == f.tracker_um.gravity]
    yield compare.by_cone(f", {PARTS['gravity']}, {f.tracker_um.gravity:g} um", here)
    ratios = [middle(row.ratio) for row in f.weighted_over_flat if row.distance_m == NEAR]
    yield say(
        "Laser tracker at {near_m:g} m: full covariances help in {n} of {of} cases; error over that of flat "
        "weights {least:.2f} to {most:.2f} in the median.",
        f,
        n=sum(ratio < 1 - ALIKE for ratio in ratios),
        of=len(ratios),
        least=min(ratios),
        most=max(ratios),
    )


def _tables(f: Row) -> dict[str, Table]:
    """Errors by model and noise, with what a um of it costs; instruments by distance."""
    found = {}
    for part, words in PARTS.items():
        title = f"{words}: RMS error, um, by noise of a reading"
        rows = compare.existing(f.sweeps[part])
        found[part] = compare.errors(rows, "name", "sigma_um", title, last="um_per_um")
    rows = [Row(row, instrument=f"{row.truth} truth: {row.instrument}") for row in f.instruments]
    title = f"KR 500, {INSTRUMENT}: RMS error, um, by distance of the instrument"
    return found | {"instruments": compare.errors(rows, "instrument", "distance_m", title)}


def figures(found: Report) -> dict[str, Figure]:
    """Error against noise for both arms."""
    f, shown, hidden = Row(found.numbers), (*columns("name sigma_um"), RMS), {*CROWD, *FILLED_CROWD}
    panes = {
        words: Table(shown, [row for row in f.sweeps[part] if row.sigma_um > 0 and row.name not in hidden])
        for part, words in PARTS.items()
    }
    counts = sorted({pick(f.trials[part] for part in PARTS) for pick in (min, max)})
    reading = (
        f"RMS errors against the truth. Marks: medians of {' to '.join(map(str, counts))} trials; bands: "
        f"{span(counts[0])} of them. Filled and dashed: with a prior. All models stand in the tables."
    )
    answer = f"{_at(f, 'gravity')} {compare.gains_told(f.gains.gravity)}"
    return {"noise_sensitivity.png": sweeps(panes, answer, reading, BANDS)}


STUDY = Study(
    name="noise_sensitivity",
    about="Identify from readings of ever more noise, and judge by the true deflections.",
    options=Options,
    settings=trial.settings,
    seeds=(1000, 4),
    arms=lambda _: [find_arm(trial.LIGHT), find_arm(HEAVY)],
    row=FitRow,
    trials=trial.trials,
    report=report,
    printed=tuple(PARTS),
    figures=figures,
    models="name",
)
