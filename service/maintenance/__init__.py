"""Looks after a farm's work over the years: films are checked (scrub), marked (taint), copied (backup) and restored."""
