"""What a run found, declared once: the trials' table, quantities, sentences; every view is made of them."""
