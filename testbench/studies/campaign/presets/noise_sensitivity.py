"""Preset `noise_sensitivity`: the cost of noise by method and structure, the gain by better instruments."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.arm.folder import find_arm
from testbench.report.figure import Figure, sweeps
from testbench.report.report import Report
from testbench.report.table import TRIAL, Row, Trials, matched
from testbench.studies.campaign import noise
from testbench.studies.campaign.noise import (
    HEAVY,
    INSTRUMENT,
    LIGHT,
    UNWEIGHTED,
    WEIGHTED,
    NoiseOptions,
    NoiseSettings,
)
from testbench.studies.campaign.report import ERROR, Preset, TrialTable, Where, duels, lines
from testbench.studies.campaign.trial import CampaignFitRow
from testbench.studies.study import DEFAULT_WITHOUT_CONE
from testbench.workflows.model_names import CLIPPED, EQUAL_FIT
from testbench.workflows.models import DEFAULT, JOINTS

GRAVITY, SIX_DOF = "KR 500, 8 poses", "108 runs of section 5.2"
TRACKER_UM = {"gravity": 50.0, "six_dof": 25.0}  #: Noise of the paper's trackers, sections 6 and 5.2.
HIDDEN = {
    *("MLS32", EQUAL_FIT, CLIPPED, "MGCO47", "MGCO68", "MGCO69", "MGCO147", DEFAULT_WITHOUT_CONE),
    *("Joints + prior", "MGCO56 + prior", "MGCO68 + prior", "MGCO69 + prior"),
}
"""Models without a line in the figure, where more would cover one another."""


def tables(_: NoiseSettings) -> Mapping[str, TrialTable]:
    """Tabulate errors by model and noise, with what a um of it costs; instruments by distance."""
    by_noise = TrialTable("", across="sigma_um", columns="um_per_um")
    read = {"part": "instrument"}
    return {
        "gravity": replace(
            by_noise, title=f"{GRAVITY}: RMS error, um, by noise of a reading", where={"part": "gravity"}
        ),
        "six_dof": replace(
            by_noise, title=f"{SIX_DOF}: RMS error, um, by noise of a reading", where={"part": "six_dof"}
        ),
        "instruments": TrialTable(
            f"KR 500, {INSTRUMENT}: RMS error, um, by distance of the instrument",
            down="instrument",
            across="distance_m",
            where=read | {"name": INSTRUMENT},
        ),
        "weights": TrialTable(
            "Full covariances beside flat weights, in the same readings",
            columns="name distance_m truth error_ratio won",
            where=read,
            rows=_weighted,
        ),
    }


def _weighted(read: Trials) -> list[Row]:
    """What full covariances of a laser tracker are worth beside flat weights, by model and truth."""
    rows = []
    for (name, truth, distance), trials in read.groups("name", "truth", "distance_m"):
        ways = trials.add(name=[way.partition(": ")[2] for way in trials["instrument"]])
        pairs = duels(ways, [(WEIGHTED, UNWEIGHTED)])
        rows += [Row(pair, name=name, truth=truth, distance_m=distance) for pair in pairs]
    return rows


def _derived(_: NoiseSettings, trials: Trials) -> Trials:
    """Add what the largest noise adds in quadrature to the error of the same trial without, per noise."""
    truths = zip(trials["truth"], trials["instrument"], strict=True)
    trials = trials.add(instrument=[own and f"{truth} truth: {own}" for truth, own in truths])
    swept, most = trials["part"] != "instrument", np.nanmax(trials["sigma_um"])
    own = trials.pick(swept)
    calm, noisy = (
        matched(own, own.where(sigma_um=sigma), ERROR, ("part", "name", TRIAL)) for sigma in (0.0, most)
    )
    added = np.full(len(trials), np.nan)
    added[swept] = np.sqrt(np.maximum(0, noisy**2 - calm**2)) / most
    return trials.add(um_per_um=added)


def _cells(asked: NoiseSettings, _: Trials) -> Mapping[str, Where]:
    """Choose the noise nearest to that of the paper's tracker, in both parts."""
    levels = [1e6 * sigma for sigma in asked.sigmas]
    return {
        words: {"part": part, "sigma_um": min(levels, key=lambda level: abs(level - TRACKER_UM[part]))}
        for words, part in ((GRAVITY, "gravity"), (SIX_DOF, "six_dof"))
    }


def figures(found: Report) -> Mapping[str, Figure]:
    """Draw error against noise for both arms."""
    panes = {
        title: lines(found, name, "name sigma_um", lambda row: row.sigma_um > 0 and row.name not in HIDDEN)
        for title, name in ((GRAVITY, "gravity"), (SIX_DOF, "six_dof"))
    }
    reading = "Marks: medians; bands: their spread. Filled and dashed: with a prior."
    return {
        "noise_sensitivity.png": sweeps(
            panes, found.question, reading, (JOINTS, DEFAULT), proportional="as the noise"
        )
    }


PRESET = Preset(
    name="noise_sensitivity",
    page="docs/studies/noise_sensitivity.md",
    question="How much do errors grow with tracker noise, for each method and structure?",
    how="Models of the 108 runs of section 5.2 are judged in check runs. Models of the KR 500, read in 8 "
    "poses by several instruments, are judged over the workspace. All levels of noise share their random "
    "numbers.",
    options=NoiseOptions,
    settings=noise.settings,
    seeds=(1000, 4),
    row=CampaignFitRow,
    trial=noise.trial,
    shared=noise.arms,
    tables=tables,
    printed="gravity",
    cells=_cells,
    check=SIX_DOF,
    derived=_derived,
    figures=figures,
    arms=lambda _: [find_arm(LIGHT), find_arm(HEAVY)],
)
STUDY = PRESET.study()
