"""Studies as Rerun recordings: views of report.json, never an input. The only importer of rerun.

One layout a kind of study, one module a layout; `pen`, `stream`, `style` and the rest are what they share.
"""
