"""Sites: the machines at one location add up their results of a tile before one result is sent to the service.

reducer.py          the process that adds up the results of a site's machines
sums.py             its unsent sums, on disk
merging.py          adds up sums of one tile
link.py             a worker's connection to the reducer
socket_deadline.py  reads from a socket with a time limit
"""
