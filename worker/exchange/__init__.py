"""What goes between a worker and the service: blobs and kernels one way, results the other.

link.py           HTTP to the service
foreign.py        the sentence about an answer that comes from no farm
trust.py          which certificate to trust
redis_tls.py      the same for Redis
cache.py          blobs by hash on this machine
kernels.py        kernels: fetched from the farm, and handed in
ready.py          a kernel made ready
ahead.py          the next one, before anybody asks for it
results.py        the way back: events and sums on the stream
errors.py         what can go wrong, by whose trouble it is
patience.py       trying again where it is the worker's own
"""
