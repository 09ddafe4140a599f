"""Files in and out: tables, robots, model folders, programs and robot languages."""
