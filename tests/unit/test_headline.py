"""What a report says first: the errors behind its badge, of the rows that it names, and its warnings."""

import numpy as np
import pytest

from testbench.report.badge import decide
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials
from testbench.runs.spread import spread
from testbench.studies.run import FEW, NOTHING, headline, warnings

ROWS = [
    Row(name="other", error_mm=0.3, rms_um=9.0),
    Row(name="rival", error_mm=spread([0.1, 0.2, 0.3]), rms_um=5.0),
    Row(name="ours", error_mm=0.1, rms_um=1e-6),
]
BADGE = decide(("ours", np.full(30, 0.1)), ("rival", np.full(30, 0.2)))


@pytest.mark.parametrize(
    ("keys", "about", "said"),
    [
        ("name error_mm rms_um", "error_mm", "Error, own weight: ours 0.100 mm; rival 0.200 mm."),
        ("name error_mm rms_um", "", "RMS error: ours exact; rival 5.00 um."),
    ],
)
def test_the_winner_and_its_rival_stand_with_the_numbers_of_their_rows(keys, about, said):
    assert headline(BADGE, Table(columns(keys), ROWS, headline=about)) == said
    assert headline(None, Table(columns(keys), ROWS)) == NOTHING


def test_fits_that_were_not_solved_are_counted_by_model_and_few_trials_are_named():
    names, status = ["a", "b"] * 20, ["solved", "solved"] * 18 + ["stopped", "solved"] * 2
    seeds = np.repeat(range(20), 2)
    trials = Trials({}).add(name=names, status=status, seed=seeds)
    assert warnings(trials) == ["Not solved in 2 of 20 fits: a."]
    assert warnings(trials.where(seed=0)) == [FEW]
