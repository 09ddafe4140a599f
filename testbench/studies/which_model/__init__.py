"""Which method an engineer should use by default, whatever the true arm and the prior are."""
