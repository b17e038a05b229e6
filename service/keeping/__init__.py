"""Looks after a farm's work over the years: films are checked (patrol), copied (backup) and restored."""
