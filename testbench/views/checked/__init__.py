"""What `testbench check` shows: words, a picture, a recording."""
