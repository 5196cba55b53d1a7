"""From a requirement to a magnet, and what tolerances do to it."""
