"""What a script has changed in a study's modules: workers import these anew, and know nothing of it."""

import hashlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from testbench.campaign.models import MODELS
from testbench.errors import BenchError

S = TypeVar("S")
W = TypeVar("W")

Trials = Callable[[S, Sequence[int]], Sequence[Sequence[W]]]


def constants(trials: Trials[S, W]) -> dict[str, list[str] | str]:
    """Lists of names in the module of a study's trials, the models that there are, and a sum of functions."""
    module = vars(sys.modules[trials.__module__])
    found: dict[str, list[str] | str] = {
        name: [*value]
        for name, value in module.items()
        if name.isupper() and isinstance(value, tuple) and all(isinstance(part, str) for part in value)
    }
    called = {name: _origin(value) for name, value in sorted(module.items()) if callable(value)}
    found["functions"] = hashlib.sha256(repr(called).encode()).hexdigest()
    found["MODELS"] = [f"{name} of {_origin(make)}" for name, make in MODELS.items()]
    return found


def _origin(value: object) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"


def checked(
    trials: Trials[S, W], ours: Mapping[str, list[str] | str], settings: S, seeds: Sequence[int]
) -> Sequence[Sequence[W]]:
    """The trials of some seeds, where this process has what the study was begun with.

    Raises:
        BenchError: When it has not: a script has changed it, and a worker has not run the script.
    """
    theirs = constants(trials)
    for name, value in ours.items():
        if theirs.get(name) != value:
            problem = f"{name} was changed by a script, which a worker knows nothing of: --workers 1"
            raise BenchError(f"{trials.__module__}: {problem}")
    return trials(settings, seeds)
