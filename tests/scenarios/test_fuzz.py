"""Random bad inputs through the real command line; `make fuzz` runs many more."""

import fuzz
import pytest


def test_no_bad_input_raises_changes_an_input_or_leaves_a_thing(tmp_path):
    found = list(fuzz.cases(fuzz.make_stock(tmp_path / "stock"), 40, 1))
    assert [(args, problem) for _, args, _, problem in found if problem] == []
    assert {code for _, _, code, _ in found} == {0, 2}


@pytest.mark.parametrize(
    ("after", "done", "said"),
    [
        ({"data.csv": "b"}, (0, "", ""), "changed"),
        ({"data.csv": "a", "new": "c"}, (2, "", "error: x\n"), "left"),
        ({"data.csv": "a", ".new.new/new/new/a": "c"}, (0, "", ""), "left"),
        ({"data.csv": "a"}, (-1, "", "Traceback"), "exit code -1"),
        ({"data.csv": "a"}, (0, "", "a warning\n"), "said"),
        ({"data.csv": "a"}, (2, "", "error: x\ny\n"), "one line"),
    ],
)
def test_what_a_command_must_not_do_is_seen(after, done, said):
    assert said in fuzz.problem(["check", "--force"], {"data.csv": "a"}, after, done)
