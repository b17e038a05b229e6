"""What is wrong with an installation, in sentences.

finding.py   what a look found: how bad it is, and what to do next
machine.py   Python, the compiler, the processor, the denoiser, the cache, the clock
folder.py    the data folder: rights, room, the database, uploads and films
running.py   the farm that runs on it: Redis, the service, the workers
"""
