"""All mistakes that are made with readings, loads and folders."""

from collections.abc import Mapping

from testbench.studies.wrong_inputs.fault import Fault
from testbench.studies.wrong_inputs.loads import LOADS
from testbench.studies.wrong_inputs.readings import READINGS

FAULTS: Mapping[str, Fault] = {**READINGS, **LOADS}
"""Mistakes by name."""
