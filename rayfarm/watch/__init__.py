"""Watching a job without a browser: in the terminal, in tev, as lines of text."""
