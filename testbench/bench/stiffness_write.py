"""The model to take of a user's runs, written as a folder."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from testbench import files
from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell
from testbench.bench.fits import Fits, Identified, Runs
from testbench.bench.model_document import AboutRow, loaded_by, weights_row
from testbench.bench.model_folder import copy_arm, write_parts
from testbench.bench.stiffness_document import (
    CertificateRow,
    Entry,
    PriorRow,
    RunsRow,
    ScaleRow,
    SpreadRow,
    StiffnessDocument,
    StructureRow,
    UnseenRow,
)
from testbench.errors import InputError
from testbench.identify.estimate import Estimate
from testbench.identify.intervals import Linearised, linearise
from testbench.identify.metric import Belief
from testbench.model.load import Load
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
    fits, estimate = found.fits, found.taken
    digests, (weights, notes) = copy_arm(cell.arm, folder), weights_known(cell.arm)
    spread = linearise(estimate)
    [row] = [m for m in fits.models if m.name == fits.recommended]
    document = StiffnessDocument(
        format=1,
        kind="stiffness",
        arm=cell.arm.name,
        digests=digests,
        name=fits.recommended,
        conservative=estimate.conservative,
        structure=_structure_row(estimate),
        links=dict(row.links),
        joints=dict(row.joints),
        units=row.units,
        prior=None if estimate.belief is None else _prior_row(estimate.belief),
        runs=_runs_row(runs, estimate),
        certificate=_certificate_row(estimate),
        unseen=_unseen_row(fits, estimate, spread),
        spread=SpreadRow(
            degrees_of_freedom=_finite(spread.tail),
            heavy_rows=spread.heavy,
            pull=spread.pull,
            on_boundary=spread.on_boundary,
        ),
        weights=weights_row(weights),
        notes=[*notes, *fits.notes],
        about=_about_row(cell, found, runs, data, notes),
    )
    write_parts(document, folder, pi=spread.pi, root=spread.root, unseen=spread.unseen, scale=spread.scale)


def _certificate_row(estimate: Estimate) -> CertificateRow:
    own = estimate.certificate
    return CertificateRow(
        status=estimate.status,
        f_m=estimate.f_m,
        f_m_floor=estimate.f_m_floor,
        duality_gap=None if own is None else own.duality_gap,
        f_m_excess_bound=None if own is None else own.f_m_excess_bound,
    )


def weights_known(arm: Arm) -> tuple[Weights, list[str]]:
    """What the links weigh, and a note where nobody knows: own weight is then left out."""
    try:
        return read_weights(arm), []
    except InputError as err:
        bodies = arm.n_joints + 2
        return Weights(np.zeros(bodies), np.zeros((bodies, 3))), [f"Own weight is left out: {err}"]


def _about_row(
    cell: Cell, found: Identified, runs: Runs, data: Mapping[str, str], notes: list[str]
) -> AboutRow:
    used = runs.used
    force, moment = loaded_by(cell.vjm, used.q, Load(used.wrench, used.point))
    return AboutRow(
        method=f"{found.fits.recommended}: {found.taken.method}",
        data=dict(data),
        doubts=[*(doubt.sentence for doubt in found.fits.doubts), *notes],
        force_N=force,
        moment_Nm=moment,
        versions=files.versions(),
    )


def _structure_row(estimate: Estimate) -> StructureRow:
    s = estimate.structure
    entries = [
        Entry(row=s.labels[a], column=s.labels[b], value=float(value))
        for a, b, value in zip(s.a, s.b, estimate.pi, strict=True)
    ]
    return StructureRow(name=s.name, symmetric=s.symmetric, entries=entries)


def _prior_row(belief: Belief) -> PriorRow:
    strength = belief.strength
    return PriorRow(
        name=belief.metric.prior,
        learnt=belief.moves is not None,
        uncertainty=float(strength.uncertainty),
        scale_uncertainty=_finite(strength.scale_uncertainty),
        coupling=None if strength.coupling is None else float(strength.coupling),
        misfit=float(belief.misfit),
        scales=[
            ScaleRow(name=s.name, factor=float(s.factor), deviation=_finite(s.deviation))
            for s in belief.scales
        ],
    )


def _runs_row(runs: Runs, estimate: Estimate) -> RunsRow:
    used, check = runs.used, runs.check
    return RunsRow(
        runs=used.runs,
        poses=len(np.unique(used.pose)),
        held_back=[] if check is None else np.unique(check.pose).tolist(),
        rejected=len(estimate.rejected),
        sigma_m=used.sigma,
        sigma_rotation_rad=used.sigma_rotation,
    )


def _unseen_row(fits: Fits, estimate: Estimate, spread: Linearised) -> UnseenRow:
    return UnseenRow(
        directions=estimate.structure.n - estimate.regression.rank,
        without_bound=len(spread.unseen),
        stiffer=list(fits.unchecked.stiffer),
        softer=list(fits.unchecked.softer),
        words=list(estimate.advice),
    )


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None
