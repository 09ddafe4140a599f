"""A virtual calibration cell for heavy industrial robot arms."""

__version__ = "0.1.0"
