"""What commands leave on the disk: all of it or nothing, and never in place of what is not of its kind."""
