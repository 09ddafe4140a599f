"""What a script has changed in the modules of a study: workers import these anew, and know nothing of it."""

import hashlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from types import ModuleType
from typing import TypeVar

from testbench.campaign.own_process import Own
from testbench.errors import BenchError

W = TypeVar("W")

ROOMS = ("testbench.studies.", "testbench.campaign.")  #: What is tried is said in these.
Trials = Callable[..., Sequence[Sequence[W]]]


def sums(trials: Trials[W]) -> dict[str, str]:
    """Sums of what the modules hold that the trials use, by module."""
    return {name: _sum(vars(sys.modules[name])) for name in _used(trials.__module__)}


def checked(
    trials: Trials[W], ours: Mapping[str, str], settings: object, own: Sequence[Own], seeds: Sequence[int]
) -> Sequence[Sequence[W]]:
    """The trials of some seeds, where this process has what the study was begun with.

    Estimators of one's own go to those that take them.

    Raises:
        BenchError: When it has not: a script has changed it, and a worker has not run the script.
    """
    theirs = sums(trials)
    for name, value in ours.items():
        if theirs.get(name) != value:
            problem = f"{name} was changed by a script, which a worker knows nothing of: --workers 1"
            raise BenchError(f"{trials.__module__}: {problem}")
    return trials(settings, seeds, own) if own else trials(settings, seeds)


def _used(first: str) -> list[str]:
    """A module, and those of `ROOMS` that it takes functions, classes and modules from, and these in turn."""
    found = [first]
    for name in found:
        for value in vars(sys.modules[name]).values():
            of = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
            if of in sys.modules and of not in found and str(of).startswith(ROOMS):
                found.append(str(of))
    return sorted(found)


def _sum(names: Mapping[str, object]) -> str:
    """A sum of functions, classes and constants by name."""
    told = [(name, _told(value)) for name, value in names.items() if callable(value) or name.isupper()]
    return hashlib.sha256(repr(sorted(told)).encode()).hexdigest()


def _told(value: object) -> str:
    """A constant, or whose function or class it is."""
    if isinstance(value, Mapping):
        return repr([(_told(key), _told(own)) for key, own in value.items()])
    if isinstance(value, list | tuple):
        return repr([*map(_told, value)])
    if isinstance(value, set | frozenset):
        return repr(sorted(map(_told, value)))
    if is_dataclass(value) and not isinstance(value, type):
        return _told(vars(value))
    if isinstance(value, str | int | float | None):
        return repr(value)
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
