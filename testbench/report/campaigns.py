"""Shared parts of studies of campaigns: the best model of a method, pairs by arm, maps of errors."""

from collections.abc import Sequence

import numpy as np

from testbench.model.structure import JOINTS, Constraint
from testbench.report.schema import best_of
from testbench.report.table import Row, Trials, merged, nested
from testbench.runs.rows import finite
from testbench.runs.spread import span
from testbench.workflows.fit_details import COMPLIANCES, predictions, residual_histograms
from testbench.workflows.workspace_errors import ErrorPlaces, WorkspacePoses, error_places

TRUE = "workspace.rms_mm"  #: What models are judged by.
NOT_OF_A_MODEL = ("seed", "truth", "true_arm", "measured.", "places.", "place_mm", "drawn.", "data_file")
"""Columns of a `CampaignRow` that are of its campaign."""


def seeds_of(seeds: range) -> int | list[int]:
    """Return what report.json says of the seeds: one number, or a list."""
    return seeds[0] if len(seeds) == 1 else list(seeds)


def seeds_label(seed: int | Sequence[int]) -> str:
    """Say of which trials a report's numbers are, for its title."""
    return f"seed {seed}" if isinstance(seed, int) else f"{len(seed)} seeds: median ({span(len(seed))})"


def dataset(trials: Trials, fitted: int | None = None) -> Row:
    """Summarise what was measured in every trial.

    Args:
        trials: Rows of the trials.
        fitted: Number of poses that are counted; None for all.

    Returns:
        The numbers.
    """
    [row] = merged(trials.where(name=trials["name"][0]).inside("measured"))
    if fitted is None:
        return row
    return Row(row, runs=row.identification_runs, points=row.identification_points, poses=fitted)


def best(models: Sequence[Row], constraint: Constraint, *, prior: bool) -> str:
    """Name the best model of one method over the workspace; joint stiffness alone is no method.

    Of those alike the one of most unknowns: MLS32 is MLS56 without what no reading tells, to the digits.

    Args:
        models: Rows of models.
        constraint: Constraint of the method.
        prior: Whether it has a prior.

    Returns:
        The name; empty for none.
    """
    own = {
        m.name: m for m in models if (m.constraint, m.prior) == (constraint, prior) and m.structure != JOINTS
    }
    alike = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    return max(alike, key=lambda name: own[name].parameters, default="")


def by_arm(trials: Trials, value: str, of: str = "name") -> list[Row]:
    """Merge a quantity of every model, or of what another column names, by true arm.

    Args:
        trials: Rows of the trials.
        value: Column of the quantity.
        of: Column of the name.

    Returns:
        Rows; none where there is one true arm.
    """
    several = len(trials.values("true_arm")) > 1
    return merged(trials.keep(of, "true_arm", value), of, "true_arm") if several else []


def error_map(trials: Trials, compared: Sequence[str]) -> ErrorPlaces:
    """Map errors of the first seed pose by pose, ordered by those models that are compared.

    Args:
        trials: Rows of the trials.
        compared: Names of the models.

    Returns:
        The errors by place.
    """
    drawn = trials.where(seed=trials["seed"][0])
    workspace_poses = WorkspacePoses(
        **nested({name: cells[0] for name, cells in drawn.keep("places.").columns.items()}).places
    )
    mm = dict(zip(drawn["name"], drawn["place_mm"], strict=True))
    return error_places(workspace_poses, mm, [name for name in dict.fromkeys(compared) if name in mm])


def details(trials: Trials, compared: Sequence[str], taken: str) -> Row:
    """Collect what figures show of the first seed's fits.

    Args:
        trials: Rows of a campaign.
        compared: Models, by name; those that are not there are left out.
        taken: The model whose compliances are set beside the true ones.

    Returns:
        `residuals` at all measured runs, `predictions` over the workspace, and `eigenvalues`, by model, and
        `compliances` of one model: see `workflows.fit_details`; nothing where no fit was kept.
    """
    first = trials.where(seed=trials["seed"][0])
    kept = {name: k for k, name in enumerate(first["name"].tolist()) if first["drawn.wrong_m"][k] is not None}
    names, whole = [name for name in compared if name in kept], min(kept.values(), default=None)
    if whole is None or not names:
        return Row()
    left, wrong, values = (
        {name: np.array(first[f"drawn.{key}"][kept[name]]) for name in names}
        for key in ("residuals_m", "wrong_m", "eigenvalues_urad_per_Nm")
    )
    parts = first["drawn.parts"][whole]
    moved = np.reshape(first["drawn.moved_m"][whole], (-1, 3))
    return Row(
        residuals=residual_histograms(left),
        predictions=predictions(moved, {name: own.reshape(-1, 3) for name, own in wrong.items()}),
        eigenvalues={
            name: [
                Row(part=part, urad_per_Nm=own[[k for k, x in enumerate(parts) if x == part]].tolist())
                for part in dict.fromkeys(parts)
            ]
            for name, own in values.items()
        },
        compliances=_compliances(first, kept[taken], [*dict.fromkeys(parts)]) if taken in kept else [],
    )


def _compliances(first: Trials, k: int, parts: Sequence[str]) -> list[Row]:
    """Restore the compliances of a model's links from row k, see `fit_details.link_compliances`."""
    shares = first["drawn.shares_percent"][k]
    joints = [*parts[len(shares) :], None]
    blocks = np.reshape(np.array(first["drawn.compliances"][k], dtype=float), (-1, len(COMPLIANCES), 6, 6))
    return [
        Row(
            {
                key: [[finite(x) for x in row] for row in block]
                for key, block in zip(COMPLIANCES, own, strict=True)
            },
            part=parts[n],
            joint=joints[n],
            share_percent=share,
        )
        for n, (share, own) in enumerate(zip(shares, blocks, strict=True))
    ]


def distinct(models: Sequence[Row]) -> list[Row]:
    """Drop completions that exist in no seed: they are least squares once more."""
    return [m for m in models if m.constraint != "free" or m.conservative is not False]


def user_estimators(models: Sequence[Row]) -> list[str]:
    """Name the user's estimators that worked in a trial."""
    return [m.name for m in models if m.constraint == "own"]
