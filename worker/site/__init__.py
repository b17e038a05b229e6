"""Sites: the machines of a site add up their sums of a tile before sending them to the service.

reducer.py          the process that adds up the results of a site's machines
sums.py             its unsent sums, on disk
merging.py          adds up sums of one tile
link.py             a worker's connection to it
socket_deadline.py  reads from a socket with a time limit
"""
