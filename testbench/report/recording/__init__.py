"""Studies as Rerun recordings: views of report.json, never an input. The only importer of rerun.

`run` draws the recording of any run in the space of `world`, `stream` writes it, and `viewer` opens it.
"""
