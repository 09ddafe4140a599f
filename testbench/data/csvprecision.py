"""Covariances of deflections in a dataset's CSV: six further columns, empty where a target was lost."""

from pathlib import Path

import numpy as np

from testbench.data.csvcells import number
from testbench.errors import Array, InputError

ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
COLUMNS = [f"deflection_cov_{name}_m2" for name in ENTRIES]
"""Covariance of the deflection, both readings together, world axes."""
READINGS = [f"{when}_{x}_m" for when in ("before", "after") for x in "xyz"]


def cells(precision: Array) -> list[list[str]]:
    """The six cells of every row.

    Args:
        precision: Inverse covariances, (rows, 3, 3) [1/m^2]; zero where the target was lost.
    """
    found = []
    for P in precision:
        C = np.linalg.inv(P) if P.any() else None
        found.append(["" if C is None else repr(float(C[a, b])) for a, b in ENTRIES.values()])
    return found


def take_out(
    path: Path, header: list[str], lines: list[list[str]]
) -> tuple[list[str], list[list[str]], Array | None]:
    """The table without these columns, and the inverse covariances that they say.

    A row whose readings and covariances are all empty is a lost target: its readings become zero.

    Args:
        path: The file.
        header: Its first line.
        lines: Its rows.

    Returns:
        Header, rows, and inverse covariances, (rows, 3, 3) [1/m^2]; None where there are no such columns.

    Raises:
        InputError: When some of the columns are missing, or a covariance is not positive definite.
    """
    have = [name for name in COLUMNS if name in header]
    if not have:
        return header, lines, None
    missing = [name for name in (*COLUMNS, *READINGS) if header.count(name) != 1]
    if missing:
        raise InputError(path, "line 1", f"covariances: expected the columns {missing} once")
    own, readings = ([header.index(name) for name in names] for names in (COLUMNS, READINGS))
    keep = [k for k in range(len(header)) if k not in own]
    precision = np.zeros((len(lines), 3, 3))
    left = []
    for i, line in enumerate(lines):
        if any(line[k].strip() for k in (*own, *readings)):
            precision[i] = _inverse(path, i + 2, [line[k] for k in own])
        else:
            line = ["0" if k in readings else cell for k, cell in enumerate(line)]
        left.append([line[k] for k in keep])
    return [header[k] for k in keep], left, precision


def _inverse(path: Path, line: int, texts: list[str]) -> Array:
    C = np.zeros((3, 3))
    for (a, b), name, text in zip(ENTRIES.values(), COLUMNS, texts, strict=True):
        C[a, b] = C[b, a] = number(path, line, name, text)
    if not np.linalg.eigvalsh(C)[0] > 0:
        raise InputError(
            path, f"line {line}", f"expected a positive definite covariance, got {C.tolist()} m^2"
        )
    P = np.linalg.inv(C)
    return np.asarray((P + P.T) / 2)
