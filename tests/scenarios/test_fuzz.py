"""Random bad inputs through the real command line; `make fuzz` runs many more."""

import fuzz


def test_no_bad_input_raises_changes_an_input_or_leaves_a_thing(tmp_path):
    found = list(fuzz.cases(fuzz.make_stock(tmp_path / "stock"), 40, 1))
    assert [(args, problem) for _, args, _, problem in found if problem] == []
    assert {code for _, _, code, _ in found} == {0, 2}
