"""The commands, one file each, with a function `register(app)`. They import heavy modules only when they run."""
