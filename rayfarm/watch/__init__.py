"""Shows a job without a browser: in the terminal, in tev, or as lines of text."""
