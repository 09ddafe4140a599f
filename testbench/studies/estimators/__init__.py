"""Estimators that only studies and benchmarks use: other programs, other solvers, resampling, shrinkage."""
