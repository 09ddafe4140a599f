"""Trials as a table: merged rows against numpy, pairs trial by trial, columns of one unit."""

from dataclasses import dataclass

import numpy as np
import pytest
from checks import UNITS, unit_of
from reports import table_of

from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.schema import EVERY, KNOWN, Table, columns
from testbench.report.table import Row, Trials, aligned, matched, merged, plain
from testbench.runs.spread import Spread
from testbench.runs.store import arrow_table, write_trials


@dataclass(frozen=True)
class Errors:
    rms_mm: float
    max_mm: float | None


@dataclass(frozen=True)
class ModelRow:
    name: str
    kind: str
    holds: bool
    unknowns: int
    advice: tuple[str, ...]
    sizes: tuple[float, ...]
    check: Errors


def rows(seed):
    rng = np.random.default_rng(seed)
    return [
        ModelRow(
            name,
            "ab"[seed % 2],
            bool(rng.integers(2)),
            6,
            (name, f"seed {seed % 3}"),
            tuple(rng.uniform(1, 2, 3).tolist()),
            Errors(float(rng.uniform(1, 9)), None if name == "one" else float(rng.uniform(1, 9))),
        )
        for name in ("two", "one")
    ]


SEEDS = range(5, 46)


@pytest.fixture
def trials():
    return table_of(SEEDS, rows)


def test_a_merged_row_holds_quantiles_shares_and_what_is_the_same(trials):
    found = {row.name: row for row in merged(trials.drop("seed"), "name")}
    assert list(found) == ["two", "one"]  # as they first appear
    own = [row for seed in SEEDS for row in rows(seed) if row.name == "two"]
    low, middle, high = np.quantile([row.check.rms_mm for row in own], [0.05, 0.5, 0.95])
    shown = found["two"].check.rms_mm
    assert (shown.p05, shown.median, shown.p95) == pytest.approx((low, middle, high))
    assert found["two"].holds == pytest.approx(np.mean([row.holds for row in own]))
    assert found["two"].unknowns == 6
    assert found["one"].check.max_mm is None  # where one is missing nothing is said of all
    assert found["two"].kind == "a | b"
    assert found["two"].advice == ["two"]  # what differs from trial to trial is told by numbers
    second = np.median([row.sizes[1] for row in own])
    assert found["two"].sizes[1].median == pytest.approx(second)
    with pytest.raises(AttributeError, match="no column 'rms'; columns are rms_mm, max_mm"):
        _ = found["two"].check.rms


def test_what_was_written_is_read_as_what_was_made(tmp_path, trials):
    write_trials(tmp_path / "trials.parquet", arrow_table(ModelRow, [(seed, rows(seed)) for seed in SEEDS]))
    own = Trials.read(tmp_path / "trials.parquet")
    assert list(own.columns) == list(trials.columns)
    assert ("holds" in own, "hold" in own) == (True, False)
    assert plain(merged(own, "name", "kind")) == plain(merged(trials, "name", "kind"))
    one = own.where(name="one").add(twice=2 * own.where(name="one")["check.rms_mm"])
    assert one["twice"].tolist() == (2 * trials.where(name="one")["check.rms_mm"]).tolist()
    both = matched(one, own.where(name="two"), "check.rms_mm", ("seed",))
    assert both.tolist() == trials.where(name="two")["check.rms_mm"].tolist()
    with pytest.raises(KeyError, match="alike in seed"):
        matched(own, own.where(name="one", seed=7), "check.rms_mm", ("seed",))


def test_a_pair_is_compared_trial_by_trial_whatever_the_order_of_the_rows(trials):
    a, b = ([next(r for r in rows(s) if r.name == n).check.rms_mm for s in SEEDS] for n in ("one", "two"))
    both = np.column_stack([a, b])
    assert aligned(trials, ("one", "two"), "check.rms_mm") == pytest.approx(both)
    shuffled = trials.pick(np.random.default_rng(0).permutation(len(trials)))
    own = aligned(shuffled, ("one", "two"), "check.rms_mm")
    np.testing.assert_allclose(own[own[:, 0].argsort()], both[both[:, 0].argsort()])
    missing = trials.pick(~((trials["name"] == "one") & (trials["seed"] == 7)))
    assert len(aligned(missing, ("one", "two"), "check.rms_mm")) == len(SEEDS) - 1


def test_rows_are_picked_by_value_and_columns_by_name(trials):
    assert set(trials.where(name="one", kind="a")["seed"]) == {s for s in SEEDS if s % 2 == 0}
    assert len(trials.where(seed=(5, 6, 7))) == 6
    assert list(trials.keep("check.").columns) == ["check.rms_mm", "check.max_mm"]
    assert "check.rms_mm" not in trials.drop("check.", "seed")
    with pytest.raises(KeyError, match="no column 'x'; columns are seed, name"):
        _ = trials["x"]


def test_a_column_shows_its_quantity_in_the_unit_of_its_heading():
    """What a field's name promises, times the scale, is what the heading says; a key stands once."""
    for column in EVERY:
        assert KNOWN[column.key] is column
        assert column.form == "yes" or f"{2.0 if column.form != 'd' else 2:{column.form}}", column
        own = unit_of(column.key)
        if own:
            assert column.unit in UNITS, column
            assert column.scale == pytest.approx(UNITS[own] / UNITS[column.unit]), column
        else:
            assert column.scale == 1, column
        if column.short and column.unit:
            assert column.short.endswith(column.unit), column


def report(**more):
    models = [Row(name="a`b", workspace=Row(rms_mm=Spread(1.5, 1.0, 2.0)), paper=None)]
    return Report(
        scenario="made_up",
        question=Markdown("Which?"),
        title=Markdown("Made up."),
        answer=say("{name} errs {workspace.rms_mm:~.2f} mm.", models[0]),
        numbers={"models": models, "none": float("nan")},
        tables={"models": Table(columns("name workspace.rms_mm"), models, bold="a`b")},
        body=["models"],
        **more,
    )


def test_names_of_strangers_are_escaped_in_sentences_and_numbers_keep_their_form():
    assert report().answer == r"a\`b errs 1.50 mm."
    assert say("{x:.1e} {names:list}", x=1.2e-8, names=["p|q", "r"]) == r"1.2 x 10^-8 p\|q and r"
    assert say("{x:.3f}", x=Spread(1.0, 0.5, 2.0)) == "1.000 (0.500 to 2.000)"
