"""Entries of the bench: files with a function `estimate`, among them those that stand in every table."""

from collections.abc import Sequence
from pathlib import Path

from testbench.arm.folder import PACKAGE
from testbench.workflows.own_estimator import read_estimators
from testbench.workflows.own_process import SUFFIX, EstimatorSource, Limits

DEFAULT = "default"  #: What identify does by default, with the class's prior.
JOINTS = "joints"
FLOORS = (JOINTS, "least-squares", "ridge", "prior")
"""Files of `entries/` that stand in every table: to be worse is to be of no use."""
FOLDERS = (PACKAGE / "entries", PACKAGE.parent / "entries")
"""Where ours are: a wheel brings them inside the package."""


def read_entries(asked: Sequence[str], limits: Limits) -> tuple[EstimatorSource, ...]:
    """The floors, then the others asked for, FILE.py or as `--estimator`; raises as `read_estimators`."""
    folder = next((folder for folder in FOLDERS if folder.is_dir()), FOLDERS[-1])
    floors = [folder / f"{name}{SUFFIX}" for name in FLOORS]
    others = [text for text in asked if Path(text).resolve() not in floors]
    return read_estimators(
        [*map(_full, map(str, floors)), *map(_full, others)], limits, (DEFAULT,), "ENTRY.py"
    )


def _full(text: str) -> str:
    """An entry as `--estimator` has it: a file alone is called by its stem, or as it is named."""
    if not text.endswith(SUFFIX):
        return text
    return f"{text}:estimate" if "=" in text else f"{Path(text).stem}={text}:estimate"
