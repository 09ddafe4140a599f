"""The model to take of a user's runs, written as a folder."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign.campaign import Cell
from testbench.campaign.fits import Identified, Runs
from testbench.campaign.model_folder import STIFFNESS, about_said, copy_arm, weights_said, write_parts
from testbench.errors import InputError
from testbench.identify.estimate import Estimate
from testbench.identify.intervals import linearise
from testbench.identify.metric import Belief
from testbench.model.load import Load, resultant
from testbench.model.vjm import tool_pose
from testbench.model.weights import Weights, read_weights


def write_stiffness(cell: Cell, found: Identified, runs: Runs, data: Mapping[str, str], folder: Path) -> None:
    """Write the model to take into a folder that exists.

    Args:
        cell: The arm that was measured.
        found: Its fits.
        runs: What was fitted.
        data: SHA-256 of every file of readings, by its name.
        folder: The model's.

    Raises:
        InputError: When a file of the arm cannot be copied.
    """
    fits, estimate, used = found.fits, found.taken, runs.used
    digests, (weights, notes) = copy_arm(cell.arm, folder), weights_known(cell.arm)
    spread, own = linearise(estimate), estimate.structure
    [row] = [m for m in fits.models if m.name == fits.recommended]
    labels = [(own.labels[a], own.labels[b]) for a, b in zip(own.a, own.b, strict=True)]
    pairs = zip(labels, estimate.pi.tolist(), strict=True)
    loads = resultant(tool_pose(cell.vjm, used.q)[1], [Load(used.wrench, used.point)])
    doubts = [*(doubt.sentence for doubt in fits.doubts), *notes]
    said = {
        "arm": cell.arm.name,
        "digests": digests,
        "name": fits.recommended,
        "conservative": estimate.conservative,
        "structure": {
            "name": own.name,
            "symmetric": own.symmetric,
            "entries": [{"row": a, "column": b, "value": value} for (a, b), value in pairs],
        },
        "links": dict(row.links),
        "joints": dict(row.joints),
        "units": row.units,
        "prior": None if estimate.belief is None else _prior(estimate.belief),
        "runs": _runs(runs, estimate),
        "certificate": _certificate(estimate),
        "unseen": {
            "directions": own.n - estimate.regression.rank,
            "without_bound": len(spread.unseen),
            "stiffer": list(fits.unchecked.stiffer),
            "softer": list(fits.unchecked.softer),
            "words": list(estimate.advice),
        },
        "spread": {
            "degrees_of_freedom": _finite(spread.tail),
            "heavy_rows": spread.heavy,
            "pull": spread.pull,
            "on_boundary": spread.on_boundary,
        },
        "weights": weights_said(weights),
        "notes": [*notes, *fits.notes],
        "about": about_said(f"{fits.recommended}: {estimate.method}", data, doubts, [loads]),
    }
    arrays = {"pi": spread.pi, "root": spread.root, "unseen": spread.unseen, "scale": spread.scale}
    write_parts(STIFFNESS, said, folder, **arrays)


def _runs(runs: Runs, estimate: Estimate) -> dict[str, object]:
    """What was fitted, and what was held back."""
    return {
        "runs": runs.used.runs,
        "poses": len(np.unique(runs.used.pose)),
        "held_back": [] if runs.check is None else np.unique(runs.check.pose).tolist(),
        "rejected": len(estimate.rejected),
        "sigma_m": runs.used.sigma,
        "sigma_rotation_rad": runs.used.sigma_rotation,
    }


def weights_known(arm: Arm) -> tuple[Weights, list[str]]:
    """What the links weigh, and a note where nobody knows: own weight is then left out."""
    try:
        return read_weights(arm), []
    except InputError as err:
        bodies = arm.n_joints + 2
        return Weights(np.zeros(bodies), np.zeros((bodies, 3))), [f"Own weight is left out: {err}"]


def _certificate(estimate: Estimate) -> object:
    own = estimate.certificate
    return {
        "status": estimate.status,
        "f_m": estimate.f_m,
        "f_m_floor": estimate.f_m_floor,
        "duality_gap": None if own is None else own.duality_gap,
        "f_m_excess_bound": None if own is None else own.f_m_excess_bound,
    }


def _prior(belief: Belief) -> object:
    strength = belief.strength
    return {
        "name": belief.metric.prior,
        "learnt": belief.moves is not None,
        "uncertainty": float(strength.uncertainty),
        "scale_uncertainty": _finite(strength.scale_uncertainty),
        "coupling": None if strength.coupling is None else float(strength.coupling),
        "misfit": float(belief.misfit),
        "scales": [
            {"name": one.name, "factor": float(one.factor), "deviation": _finite(one.deviation)}
            for one in belief.scales
        ],
    }


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None
