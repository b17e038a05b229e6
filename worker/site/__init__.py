"""Sites: the machines of a site add up their sums of a tile before these travel to the service.

reducer.py        the process that adds up what a site's machines have rendered
sums.py           the sums it holds, on disk
merging.py         sums of one tile into one
link.py           a worker's connection to it
socket_deadline.py          reads from a socket with a time limit
"""
