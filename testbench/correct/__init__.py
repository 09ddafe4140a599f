"""The robot corrected: where the tool is under load, how sure that is, and which joints put it right."""
