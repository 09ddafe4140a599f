"""What people see: tables, words, figures, recordings; all of it written from reports."""
