"""Folders of stiffness models, as `testbench identify` leaves them."""

from testbench.workflows.fits import MeasuredRuns, fit_models, write_stiffness


def identified(cell, model, runs, folder):
    """The folder of a model that is fitted to runs; the estimate in it."""
    folder.mkdir()
    own = MeasuredRuns("runs.csv", runs, runs, None)
    found = fit_models(cell, [model], own, lambda: 0.0)
    write_stiffness(cell, found, {"runs.csv": "0" * 64}, folder)
    return found.taken
