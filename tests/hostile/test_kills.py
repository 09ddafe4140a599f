"""A few kills at random moments; `tools/kills.py` does hundreds, of every long command."""

import random
import sys

import kills
import pytest
import trial_study
from run_here import here

SECONDS = 0.8  #: Until which the moments lie: less than a run takes.


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_study_that_is_killed_leaves_nothing_running_loses_nothing_and_ends_the_same(tmp_path):
    with kills.bench(tmp_path) as place:
        out = place.folder / "out"
        assert here(trial_study.app, out, "--workers", 1).returncode == 0
        trials = sum(kills.stored(place.folder).values())
        whole = kills.Whole(place.files(), SECONDS, rest=SECONDS, trials=trials)
        ways = kills.chain(kills.CASES["trials"], place, whole, random.Random(1), kills=3)
        assert kills.hits(ways) == 3
