"""Entries of the bench: files with a function `estimate`, among them those that stand in every table."""

from collections.abc import Sequence
from pathlib import Path

from testbench.arm.catalogue import PACKAGE
from testbench.campaign.own_estimator import read_own
from testbench.campaign.own_limits import Limits
from testbench.campaign.own_process import SUFFIX, Own

FUNCTION = "estimate"
DEFAULT = "default"  #: What identify does by default, with the class's prior.
JOINTS = "joints"
FLOORS = (JOINTS, "least-squares", "ridge", "prior")
"""Files of `entries/` that stand in every table: to be worse is to be of no use."""
FOLDERS = (PACKAGE / "entries", PACKAGE.parent / "entries")
"""Where ours are: a wheel brings them inside the package."""


def read_entries(asked: Sequence[str], limits: Limits) -> tuple[Own, ...]:
    """The floors, then the others that were asked for, FILE.py or as of `--estimator`.

    Raises:
        BenchError: When one cannot be imported, has no function, or has the name of another.
    """
    folder = next((folder for folder in FOLDERS if folder.is_dir()), FOLDERS[-1])
    floors = [folder / f"{name}{SUFFIX}" for name in FLOORS]
    others = [text for text in asked if Path(text).resolve() not in floors]
    return read_own([*map(_full, map(str, floors)), *map(_full, others)], limits, (DEFAULT,))


def _full(text: str) -> str:
    """An entry as `--estimator` has it: a file alone is called by its stem and has the usual function."""
    return f"{Path(text).stem}={text}:{FUNCTION}" if text.endswith(SUFFIX) and "=" not in text else text
