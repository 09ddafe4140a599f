"""Which methods are best over the workspace, and what a prior is worth."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from testbench.bench.baselines import JOINTS, distinct, gain, is_least_squares
from testbench.identify import Constraint
from testbench.studies.identifiability.methods import Filling, ModelRow
from testbench.trials.gain import Gain
from testbench.trials.spread import Number, grouped, middle
from testbench.views.markdown import listed
from testbench.views.schema import best_of, show

METHODS: dict[tuple[Constraint, Filling], str] = {
    ("none", "none"): "least squares",
    ("free", "none"): "conservative least squares of equal fit",
    ("none", "prior"): "least squares with prior",
    ("psd", "none"): "GCO",
    ("psd", "least trace"): "GCO of least trace",
    ("psd", "prior"): "GCO with prior",
    ("psd", "log-det prior"): "GCO with log-det prior",
}


@dataclass(frozen=True)
class Leaders:
    """Methods of least error over the workspace, each with its best structures; several are alike."""

    methods: tuple[str, ...]
    rms_mm: Number

    @property
    def words(self) -> str:
        """Who, and how far off."""
        alike = " (alike)" if len(self.methods) > 1 else ""
        return f"{listed(list(self.methods))}{alike}, {show(self.rms_mm)} mm"


@dataclass(frozen=True)
class Worth:
    """GCO's error over the workspace without a prior, with it, and with the least trace in its metric."""

    name: str
    without_mm: Number
    with_mm: Number
    trace_mm: Number
    times: float


@dataclass(frozen=True)
class Gains:
    """The best model over the workspace, seed by seed; None beside itself."""

    least_squares: Gain | None  #: Beside the best of least squares without a prior.
    joints: Gain | None  #: Beside joints alone.


def gains(models: Sequence[ModelRow], by_name: Mapping[str, Sequence[ModelRow]]) -> Gains:
    """The best of all models beside least squares and joints alone; of those alike one that is by GCO.

    Args:
        models: Every model over all seeds.
        by_name: Its rows, one a seed.
    """
    own = {m.name: m for m in distinct(list(models))}
    best = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    ours = sorted(best, key=lambda name: own[name].constraint != "psd")[0]
    plain = {
        name: m.workspace.rms_mm
        for name, m in own.items()
        if is_least_squares(m.structure, m.constraint, prior=m.prior)
    }
    return Gains(*(gain(by_name, ours, theirs) for theirs in (best_of(plain).names[0], JOINTS)))


def leaders(models: Iterable[ModelRow]) -> Leaders:
    """The best methods, each with its best structures."""
    found: dict[str, Number] = {}
    told = distinct(list(models))
    for (constraint, filling), own in grouped(told, lambda m: (m.constraint, m.filling)).items():
        errors = {m.structure: m.workspace.rms_mm for m in own}
        names = best_of(errors).names
        found[f"{METHODS[constraint, filling]} ({listed(list(names))})"] = errors[names[0]]
    methods = best_of(found).names
    return Leaders(methods, found[methods[0]])


def worth(models: Sequence[ModelRow]) -> list[Worth]:
    """What a prior is worth to the structures that were tried without it too."""
    errors = {(m.filling, m.structure): m.workspace.rms_mm for m in models if m.constraint == "psd"}
    found = []
    for filling, name in errors:
        if filling == "none" and ("prior", name) in errors:
            without, ours, trace = (errors[f, name] for f in (filling, "prior", "least trace"))
            found.append(Worth(name, without, ours, trace, middle(without) / middle(ours)))
    return found
