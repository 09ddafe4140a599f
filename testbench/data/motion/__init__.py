"""Joint moves in the languages of robots' controllers: plain text files, one language a module."""
