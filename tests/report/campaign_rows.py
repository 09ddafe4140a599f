"""Made-up trials of every preset of a campaign: rows of a seed, no two numbers alike."""

from dataclasses import replace
from itertools import product

import numpy as np
from made_up import of_one_trial
from reports import AT, campaign_row, fit_row

from testbench.plant.true_arms import HELD_OUT_TRUE_ARMS, true_arm_of_seed
from testbench.studies.campaign import (
    gravity_calibration,
    identifiability,
    model_error,
    noise_sensitivity,
    regimes,
    which_model,
)
from testbench.studies.campaign.coverage import Covered
from testbench.studies.campaign.trial import CampaignFitRow, Cover
from testbench.studies.campaigns import CampaignRow
from testbench.workflows.campaign import Scenario
from testbench.workflows.rows import ErrorRow

MODELS = {
    "Joints": ("Joints", "none", False),
    "MLS56": ("MLS56", "none", False),
    "MLS56, PSD of equal fit": ("MLS56", "free", False),
    "MGCO56": ("MGCO56", "psd", False),
    "MLS56 + prior": ("MLS56", "none", True),
    "MGCO56 + prior": ("MGCO56", "psd", True),
    "LS153 + prior": ("LS153", "none", True),
    "ALL153 + prior": ("ALL153", "psd", True),
}
"""Structure, constraint and whether there is a prior."""
DEFAULT = "ALL153 + prior"
SIGMAS = (0.0, 25.0, 50.0, 200.0)
CASES = list(model_error.disturbances(1.0))


def fit(kind, rng, name, **own):
    return fit_row(kind, rng, MODELS, name, status="solved", **own)


def of_noise(seed):
    rng, arm = np.random.default_rng(seed), true_arm_of_seed("family", seed)
    for (part, truth), sigma, name in product(
        {"six_dof": "linear", "gravity": "nonlinear"}.items(), SIGMAS, MODELS
    ):
        yield fit(CampaignFitRow, rng, name, part=part, truth=truth, sigma_um=sigma, true_arm=arm)
    ways = ("weighted", "flat weights", "weighted, frame drifts")
    for truth, (name, way) in product(("linear", "nonlinear"), product(("MGCO56 + prior", DEFAULT), ways)):
        own = {"part": "instrument", "truth": truth, "instrument": way, "distance_m": 4.0, "true_arm": arm}
        yield fit(CampaignFitRow, rng, name, **own)


def of_disturbances(seed):
    rng, own = np.random.default_rng(seed), true_arm_of_seed("family", seed)

    def row(case, sigma, name, part, arm, size):
        factors = {"part": part, "true_arm": arm, "size": size, "case": case, "sigma_um": sigma}
        found = fit(model_error.DisturbedRow, rng, name, **factors)
        return replace(found, cover=Cover(100 * rng.uniform(), 0.1, 0.1) if sigma else None)

    for case, sigma, name in product(CASES, (0.0, 40.0), MODELS):
        yield row(case, sigma, name, model_error.IN_FAMILY, own, 1.0)
    for arm, size in [(own, 0.5), (own, 2.0), *((arm, 1.0) for arm in HELD_OUT_TRUE_ARMS)]:
        for name in model_error.BESIDE:
            yield row(model_error.ALL, 40.0, name, model_error.BESIDE_IT, arm, size)


LINKS = ("link_1", "link_2")


def of_family(seed):
    rng = np.random.default_rng(seed)
    for arm, prior in which_model.pairs(seed):
        wrong = {"link": LINKS[seed % 2], "joints": "joints"}.get(prior)
        share = rng.uniform(0.01, 0.04) + 0.05 * (wrong == LINKS[1]) if prior == "link" else None
        case = {"true_arm": arm, "prior_error": prior, "wrong": wrong, "link_share": share}
        for name, poses in product((which_model.CHOSEN, *MODELS), which_model.POSES):
            heard = tuple(n for n in (*LINKS, "joints") if rng.random() < 0.4)
            unread = tuple(n for n in LINKS if rng.random() < 0.5) if prior == "link" else None
            chosen = name == which_model.CHOSEN
            own = {
                "chosen": DEFAULT if chosen else None,
                "cover": Cover(*rng.uniform(20, 90, 3)) if name in which_model.COVERED else None,
                "doubted": which_model.Doubted(heard, unread) if chosen else None,
            }
            found = fit(
                which_model.FamilyMethodRow, rng, DEFAULT if chosen else name, poses=poses, **case, **own
            )
            yield replace(found, name=name)


METHODS = {
    regimes.GCO: "psd", regimes.SQUARES: "none", regimes.EQUAL: "free", regimes.LENT: "none",
    regimes.JOINTS: "none",
}  # fmt: skip
EXPECTED = {"0 to 1 %": 0.005, "10 to 30 %": 0.2, "over 100 %": 2.0}
GRIDS = regimes.GridSettings(
    1,
    ("tubes", "cast"),
    gravity=replace(regimes.GRAVITY, poses=(8, 12), sigmas=(15e-6, 50e-6)),
    full_pose=replace(regimes.FULL_POSE, poses=(2, 4), sigmas=(25e-6, 100e-6)),
)


def of_grids(seed):
    rng = np.random.default_rng(seed)
    for kind, grid in GRIDS.grids.items():
        cases = product(GRIDS.truths, ("MGCO56", "ALL153"), grid.cells)
        for arm, structure, (poses, sigma) in cases:
            cell = {"part": kind, "true_arm": arm, "structure": structure, "poses": poses}
            cell |= {"sigma_um": 1e6 * sigma, "status": "solved", "prior": False}
            cell |= {"expected": float(rng.choice([*EXPECTED.values()])), "binds": bool(rng.integers(2))}
            for name, constraint in METHODS.items():
                yield of_one_trial(regimes.GridMethodRow, rng, **cell, name=name, constraint=constraint)


FILLED = {
    "Joints": ("Joints", "none", "none"),
    "MLS56": ("MLS56", "none", "none"),
    "MGCO56": ("MGCO56", "psd", "none"),
    "MGCO56, LS + prior": ("MGCO56", "none", "prior"),
    "MGCO56, GCO + prior": ("MGCO56", "psd", "prior"),
}
COVERED = {"a": "linearised", "b": "posterior", "d": "learnt", "e": "believed"}


def of_priors(seed):
    rng = np.random.default_rng(seed)
    swept = {"scale": (0.2, 2.5), "poses": (5, 13)}
    cases = [("linear", {}), ("nonlinear", {}), *((key, {key: x}) for key in swept for x in swept[key])]
    for (part, at), (name, (structure, constraint, filling)) in product(cases, FILLED.items()):
        own = {"name": name, "structure": structure, "constraint": constraint, "filling": filling}
        own |= {"prior": filling == "prior", "parameters": 56, "rank": 27, "status": "solved"}
        own |= {"part": part, "scale": None, "poses": None, "true_arm": "tubes"} | at
        yield identifiability.TrialRow(fit=of_one_trial(identifiability.PriorMethodRow, rng, **own))
    for name, kind in COVERED.items():
        inside = tuple(bool(own) for own in rng.integers(4, size=6))
        yield identifiability.TrialRow(
            intervals=Covered(name, kind, inside, (*rng.uniform(10, 90, 5), np.inf))
        )


def of_calibration(seed):
    rng = np.random.default_rng(seed)
    for name, (structure, constraint, prior) in MODELS.items():
        errors = {part: of_one_trial(ErrorRow, rng) for part in ("workspace", "check", "check_true")}
        placed = {"places": AT, "place_mm": (*rng.uniform(1, 9, 2),)} if seed == 1 else {}
        own = {"structure": structure, "constraint": constraint, "prior": prior, "status": "solved"}
        own |= {"parameters": 56, "rank": 27, "true_arm": true_arm_of_seed("family", seed)}
        own["held_by_trace_weight"] = name == "MGCO56"
        yield campaign_row(CampaignRow, rng, name, **errors | placed | own)


ARM = "kr500_l480"
TRIALS = {
    "noise_sensitivity": (
        noise_sensitivity.NoiseSettings(1, sigmas=tuple(x / 1e6 for x in SIGMAS)),
        of_noise,
    ),
    "model_error": (model_error.DisturbanceSettings(ARM, 1, sigma=40e-6), of_disturbances),
    "which_model": (which_model.FamilySettings(ARM, 1), of_family),
    "regimes": (GRIDS, of_grids),
    "identifiability": (identifiability.PriorSettings(ARM, Scenario(arm=ARM), 1, 9, 9, 9), of_priors),
    "gravity_calibration": (gravity_calibration.CalibrationSettings(ARM, Scenario(arm=ARM)), of_calibration),
}
"""Settings and what makes the rows of a seed, by the name of the preset."""
