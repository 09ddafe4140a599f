"""The shell of every command: its flags, its exit codes, its progress bar."""
