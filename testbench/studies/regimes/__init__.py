"""Where the cone pays by itself: GCO against least squares of the same structure on the same data."""
