"""A real UR10: the ladder from geometry to joint errors on public readings, series against series."""
