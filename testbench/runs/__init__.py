"""The engine of trials: independent trials of a study on all cores or a cluster, stored as they come."""
