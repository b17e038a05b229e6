"""The machine a worker runs on, and the worker's processes.

health_file.py          a file that says how the worker is, for the health check of its container
process_tree.py         all processes of this worker
presence.py       whether somebody is using the machine
status.py         what each slot is doing, in shared memory
joint_pieces.py         the folder that slots share while they render a tile together
"""
