"""Maintenance of a farm's data: checks films (scrub), marks jobs with distrusted samples (taint), backs up and restores.

Deletes old data (retention), and reuses samples of earlier jobs (reuse).
"""
