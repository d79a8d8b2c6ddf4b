"""A sensor, a filter and a display, each a process of its own."""
