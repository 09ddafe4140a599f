"""A virtual calibration cell for heavy industrial robot arms."""
