"""The machine that a worker runs on, and the worker's processes.

health_file.py   a file with the worker's state, for the health check of its container
process_tree.py  all processes of this worker
presence.py      whether a user is at the machine
status.py        the current work of each slot, in shared memory
joint_pieces.py  the folder by which slots share the work on one tile
cards_worker.py  the second worker of the machine, which renders with its graphics cards
"""
