"""One file a command; each has `register(app)`. What is heavy is imported when a command runs, so that --help is quick."""
