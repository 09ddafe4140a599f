"""An open bench: anybody's estimator in frozen tasks, beside the default of identify and ours."""
