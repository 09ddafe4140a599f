"""What a dataset can tell of a structure: the report before any fit, its words, table and figure."""
