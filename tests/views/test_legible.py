"""The look that every figure of the tests gets finds what a reader could not read."""

import pytest
from legible import check_legible

from testbench.report import figure as views
from testbench.report.figure import page, say
from testbench.studies import run


def drawn():
    """A figure with nothing to mend."""
    figure = page(3)
    axes = figure.subplots()
    for k, name in enumerate(("one", "two")):
        axes.plot([0, 1], [k, 1 - k], color=f"C{k}", label=name)
    axes.legend()
    say(figure, "Two lines cross", "Lines: made up.")
    return figure, axes


def looked_at(figure):
    figure.draw_without_rendering()
    check_legible(figure)


def test_a_sound_figure_passes():
    looked_at(drawn()[0])


FAULTS = {
    "in wide": lambda figure, axes: figure.set_figwidth(12),
    "too small": lambda figure, axes: axes.set_xlabel("small", fontsize=8),
    "not for a reader": lambda figure, axes: axes.set_xlabel("rms_mm"),
    "cut": lambda figure, axes: axes.text(1, 0.5, "some long words").set_in_layout(False),
    "over one another": lambda figure, axes: [axes.text(0.5, y, "words") for y in (0.5, 0.51)],
    "swatches alike": lambda figure, axes: [
        line.set_color("black") for line in axes.get_legend().legend_handles
    ],
}


@pytest.mark.parametrize("said", FAULTS)
def test_a_fault_is_found(said):
    figure, axes = drawn()
    FAULTS[said](figure, axes)
    with pytest.raises(AssertionError, match=said):
        looked_at(figure)


def test_figures_of_studies_are_looked_at_where_they_are_written_and_those_of_commands_where_asked(
    legible, tmp_path
):
    figure, axes = drawn()
    axes.set_xlabel("rms_mm")
    with pytest.raises(AssertionError, match="not for a reader"):
        run.save(figure, tmp_path / "a.png")
    with legible(), pytest.raises(AssertionError, match="not for a reader"):
        views.save(figure, tmp_path / "a.png")
