"""A whole farm on one machine.

farm.py        what `rayfarm up` starts, in which order, and when it is ready
supervisor.py  processes: started, watched, restarted, stopped, none left behind
broker.py      a real Redis of our own
state.py       the data folder: its lock, its secrets, the address of the farm that runs on it
"""
