"""Tracker readings of a UR10 as published become series of the arm `ur10`, in models/ur10/readings.

    python tools/ur10_readings.py series_A_every_8th.csv series_C.csv

Commanded joints and what was measured there; the commanded poses of the target stay out.
"""

import sys
from pathlib import Path

from testbench.arm.folder import load_arm
from testbench.files.read_series import read_series
from testbench.files.write import write_series

ROOT = Path(__file__).resolve().parents[1]
MAP = ROOT / "docs" / "maps" / "ur10.toml"
READINGS = ROOT / "models" / "ur10" / "readings"
DECIMALS = 6  #: 1 um and 1 urad, where the cell repeats to 20 um or more.
MOST = 700_000  #: Size of the folder [byte].


def main(files: list[Path]) -> None:
    """Convert each file to one of its name."""
    arm = load_arm(ROOT / "models" / "ur10")
    READINGS.mkdir(exist_ok=True)
    for file in files:
        export = read_series(file, arm, MAP)
        write_series(READINGS / f"{file.stem}.csv", arm, export.series, decimals=DECIMALS)
        rows = sum(series.n_rows for series in export.series)
        print(f"{file.stem}: {rows} rows", *export.notes, sep="\n  ")
    size = sum(file.stat().st_size for file in READINGS.iterdir())
    if size > MOST:
        sys.exit(f"{READINGS}: {size} bytes, expected at most {MOST}")
    print(f"{READINGS.name}: {size} bytes")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
