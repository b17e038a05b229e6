"""A whole farm on one machine.

farm.py        the parts that `rayfarm up` starts, their order, and when they are ready
early.py       processes that import in parallel with the command line, and then wait for their options
supervisor.py  processes: started, watched, restarted, and stopped with all their children
broker.py      the farm's own Redis
state.py       the data folder: its lock, its secrets, the address of the farm that runs on it
"""
