"""User estimators beside ours: their flags, their models, and the checks of their answers."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.arm.stiffness import SYMMETRY_TOLERANCE, eigenvalue_scale
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import Estimate
from testbench.identify.estimate import deflections, make_estimate
from testbench.identify.fold import reduce
from testbench.identify.prior import Prior
from testbench.model.structure import Structure, all153
from testbench.model.vjm import Vjm
from testbench.runs import manifest as files
from testbench.workflows.cell import Cell
from testbench.workflows.models import MODELS, Model
from testbench.workflows.own_process import SUFFIX, EstimatorSource, Limits, call_estimator, file_of

FLAG = "--estimator"
FORM = "[NAME=]FILE.py:function or [NAME=]module:function"
ASKED = re.compile(r"(?:(?P<name>[^=:/]*)=)?(?P<source>[^:]+):(?P<function>[^\W\d]\w*)")
ESTIMATOR_NAME = re.compile(r"[^\W\d][\w-]{0,39}")
MAX_COMPLIANCE = 1.0
"""Largest compliance and covariance of an answer [SI]: no arm gives way by a metre under a newton."""
MODULE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*")


@dataclass(frozen=True)
class LimitOptions:
    """Hold the flags of what a call may use."""

    estimator_timeout: Annotated[
        float, typer.Option(min=0.01, max=86_400, metavar="S", help="Time limit of a call of --estimator.")
    ] = 60.0
    estimator_memory: Annotated[
        float, typer.Option(min=0.01, max=1000, metavar="GB", help="Memory limit of a call of --estimator.")
    ] = 2.0

    @property
    def limits(self) -> Limits:
        """Return the limits of a call."""
        return Limits(self.estimator_timeout, int(1e9 * self.estimator_memory))


@dataclass(frozen=True)
class EstimatorOptions(LimitOptions):
    """Hold the flags of every command and study that tries a user's estimators."""

    estimator: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE.py:function", help="Your own estimator; repeatable."),
    ] = None

    @property
    def own(self) -> tuple[EstimatorSource, ...]:
        """Read the estimators that were asked for; BenchError as `read_estimators`."""
        return read_estimators(self.estimator or (), self.limits, tuple(MODELS))


def read_estimators(
    texts: Sequence[str], limits: Limits, taken: Sequence[str], flag: str = FLAG
) -> tuple[EstimatorSource, ...]:
    """Read estimators from the command line; each is imported once, in a process apart.

    BenchError when one cannot be imported, lacks its function, or has a name that is taken.

    Args:
        texts: Values of the flag.
        limits: Limits of a call.
        taken: Names that are taken.
        flag: Name of the flag, for messages.

    Returns:
        The estimators.
    """
    estimator_sources = tuple(_read(text, limits, flag) for text in texts)
    names = [estimator_source.name for estimator_source in estimator_sources]
    for name in names:
        if names.count(name) > 1 or name.casefold() in map(str.casefold, taken):
            raise BenchError(f"{flag}: the name {name!r} is taken: put another before it, NAME=...")
    return estimator_sources


def _read(text: str, limits: Limits, flag: str) -> EstimatorSource:
    found = ASKED.fullmatch(text)
    source = found["source"] if found else ""
    if not found or not (source.endswith(SUFFIX) or MODULE.fullmatch(source)):
        raise BenchError(f"{flag}: expected {FORM}, got {text!r}")
    name = found["function"] if found["name"] is None else found["name"]
    if not ESTIMATOR_NAME.fullmatch(name):
        raise BenchError(f"{flag}: expected a name of letters, digits, _ and -, got {name!r}")
    if source.endswith(SUFFIX):
        source = str(Path(source).resolve())
        files.digest(Path(source))  # refuses what is no file
    estimator_source = EstimatorSource(name, source, found["function"], limits)
    try:
        return replace(estimator_source, sha256=files.digest(file_of(estimator_source)))
    except BenchError as err:
        raise BenchError(f"{flag}: {source}: {err}") from err


def digests_of(estimator_sources: Sequence[EstimatorSource]) -> dict[str, dict[str, str]]:
    """Collect SHA-256 of the files of estimators, by the estimator's name, for manifest.json."""
    return {"estimators": {each.name: each.sha256 for each in estimator_sources}} if estimator_sources else {}


Models = Callable[[Cell, Prior | None], list[Model]]


def check_unchanged(estimator_sources: Sequence[EstimatorSource]) -> None:
    """Refuse, by BenchError, a file that is not the one that was asked for."""
    for each in estimator_sources:
        if files.digest(file_of(each)) != each.sha256:
            raise BenchError(f"{FLAG}: {each.source} has changed since the run began")


def estimator_models(estimator_sources: Sequence[EstimatorSource]) -> Models:
    """Return a function that makes their models of a cell and the prior of a trial.

    Raises:
        BenchError: When a file has changed, see `check_unchanged`.
    """
    check_unchanged(estimator_sources)
    return lambda cell, prior: [
        Model(each.name, replace(all153(cell.arm), name=f"own {k}"), UserEstimator(each, prior))
        for k, each in enumerate(estimator_sources, 1)
    ]


@dataclass(frozen=True)
class UserEstimator:
    """Call a user's estimator like any method."""

    own: EstimatorSource
    prior: Prior | None  #: Of the trial; None where there is none.

    def __call__(self, vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
        """Its answer, judged as every estimate is; BenchError where it has none."""
        pi = parameters_of(structure, call_estimator(self.own, (vjm, structure, data, self.prior)).values)
        words = f"own estimator {self.own.function}"
        estimate = make_estimate(reduce(vjm, structure, data), pi, method=words, constraint="own")
        check_reach(deflections(vjm, estimate, data), vjm)
        return estimate


def check_reach(moved: Array, vjm: Vjm) -> None:
    """Refuse predictions that no arm can have.

    Args:
        moved: Predicted deflections, (runs, m, 3) [m].
        vjm: The arm.

    Raises:
        BenchError: When one is no number, or longer than the arm reaches.
    """
    most = np.linalg.norm(moved, axis=-1).max()
    if not most <= vjm.reach:
        raise BenchError(f"predicts a deflection of {most:,.0f} m: the arm reaches {vjm.reach:.3g} m")


def parameters_of(structure: Structure, found: Array) -> Array:
    """Read parameters from an answer: they, or compliances (n_theta, n_theta).

    Args:
        structure: The unknowns.
        found: The answer.

    Returns:
        Parameters, (n,).

    Raises:
        BenchError: When it has another shape, has a number that no arm can have, or its compliances are not
            symmetric or have entries that are no unknowns.
    """
    n, size = structure.n, structure.n_theta
    if found.shape not in ((n,), (size, size)):
        raise BenchError(f"wrong shape: expected ({n},) or ({size}, {size}), got {found.shape}")
    if not np.isfinite(found).all():
        raise BenchError("expected finite numbers, got NaN or infinity")
    if np.abs(found).max() > MAX_COMPLIANCE:
        raise BenchError(f"expected compliances of at most {MAX_COMPLIANCE:g} in SI units, got a larger one")
    if found.ndim == 1:
        return found
    scale = eigenvalue_scale(found)
    if np.abs((found - found.T) / np.outer(scale, scale)).max() > SYMMETRY_TOLERANCE:
        raise BenchError("not symmetric: expected compliances that are their own transpose")
    rest = np.argwhere((found != 0) & (structure.matrix(np.ones(structure.n)) == 0))
    if len(rest):
        a, b = rest[0]
        raise BenchError(f"expected 0 between {structure.labels[a]} and {structure.labels[b]}: no unknown")
    return structure.entries(found)
