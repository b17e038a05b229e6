"""One file per command; each has `register(app)`. Heavy modules are imported when a command runs, so that --help is quick."""
