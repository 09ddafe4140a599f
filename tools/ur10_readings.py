"""Tracker readings of a UR10 as published become series of the arm `ur10`, in models/ur10/readings.

    python tools/ur10_readings.py series_A_every_8th.csv series_C.csv

Commanded joints and what was measured there; the commanded poses of the target stay out.
"""

import csv
import sys
from pathlib import Path

from testbench.arm.folder import load_arm
from testbench.files.read_series import read_series
from testbench.files.write import write_series

ROOT = Path(__file__).resolve().parents[1]
MAP = ROOT / "docs" / "maps" / "ur10.toml"
READINGS = ROOT / "models" / "ur10" / "readings"
DECIMALS = {"temperature": 2}  #: By column; 6 of others: 1 um and 1 urad, where the cell repeats to 20 um.
DIGITS = 4  #: Of standard deviations and covariances.
MOST = 700_000  #: Size of the folder [byte].


def shorten(file: Path) -> None:
    """Round the numbers of a file of readings."""
    with file.open(newline="") as text:
        header, *rows = csv.reader(text)
    with file.open("w", newline="") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(header)
        lines.writerows([rounded(*cell) for cell in zip(header, row, strict=True)] for row in rows)


def rounded(column: str, cell: str) -> str:
    """Round a cell; whole numbers and texts stay."""
    if column.startswith("sigma") or "_cov_" in column:
        return f"{float(cell):.{DIGITS}g}" if cell else ""
    return repr(round(float(cell), DECIMALS.get(column, 6)) + 0.0) if "." in cell or "e" in cell else cell


def main(files: list[Path]) -> None:
    """Convert each file to one of its name."""
    arm = load_arm(ROOT / "models" / "ur10")
    READINGS.mkdir(exist_ok=True)
    for file in files:
        export = read_series(file, arm, MAP)
        write_series(READINGS / f"{file.stem}.csv", arm, export.series)
        shorten(READINGS / f"{file.stem}.csv")
        rows = sum(series.n_rows for series in export.series)
        print(f"{file.stem}: {rows} rows", *export.notes, sep="\n  ")
    size = sum(file.stat().st_size for file in READINGS.iterdir())
    if size > MOST:
        sys.exit(f"{READINGS}: {size} bytes, expected at most {MOST}")
    print(f"{READINGS.name}: {size} bytes")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
