"""Reports of runs: numbers, tables and sentences, each declared once; all views are made from them."""
