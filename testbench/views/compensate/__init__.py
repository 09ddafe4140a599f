"""What `testbench compensate` shows: words, a picture, a recording."""
