"""The commands, one file each, with a function `register(app)`. Heavy modules are imported when a command runs."""
