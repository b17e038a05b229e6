"""Checks of an installation, whose results are sentences.

finding.py  the result of a check: its severity, and what to do next
machine.py  Python, the compiler, the processor, the denoiser, the cache, the clock
folder.py   the data folder: permissions, free space, the database, uploads and films
running.py  the farm that runs on it: Redis, the service, the workers
"""
