"""Maintenance of a farm: films are checked (scrub), marked (taint), backed up (backup) and restored.

Old data is deleted (retention).
"""
