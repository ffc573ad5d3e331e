"""Commands: thin, the work is elsewhere."""
