"""A plan as people see it: tables, one page, a figure, a recording, and the folder of them all."""
