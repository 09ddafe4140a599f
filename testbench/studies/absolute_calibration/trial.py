"""One trial: a true arm, measured and explained in every way that is asked."""

from collections.abc import Iterator, Sequence

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.studies.absolute_calibration.measure import Asked, measure, rows
from testbench.studies.absolute_calibration.rows import Row
from testbench.studies.absolute_calibration.settings import (
    ABSOLUTE,
    BY_POSES,
    CAMPAIGN,
    CAMPAIGNS,
    FINAL,
    HIDING,
    HIDING_ARMS,
    MIXED,
    OTHER_ARMS,
    PAIRS,
    REAL,
    WITH_LINKS,
    Settings,
)


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[Row]]:
    """Rows of some seeds."""
    cells = {name: build_cell(find_arm(name)) for name in asked.arms}
    return [list(_trial(cells[asked.arm_of(seed)], asked, seed)) for seed in seeds]


def _trial(cell: Cell, asked: Settings, seed: int) -> Iterator[Row]:
    for n in asked.numbers_of(seed):
        models = (*BY_POSES, WITH_LINKS) if n == asked.featured else BY_POSES
        yield from rows(measure(cell, Asked(REAL, ABSOLUTE, n), seed), models, optimum=True)
    for true in HIDING_ARMS:
        yield from rows(measure(cell, Asked(true, ABSOLUTE, asked.featured), seed), HIDING)
    for true in OTHER_ARMS:
        yield from rows(measure(cell, Asked(true, ABSOLUTE, asked.featured), seed), FINAL)
    for name in (MIXED, PAIRS):
        poses, loaded = (round(share * asked.featured) for share in CAMPAIGNS[name])
        yield from rows(measure(cell, Asked(REAL, name, poses, loaded), seed), CAMPAIGN)
