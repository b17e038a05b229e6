"""Data exchange between a worker and the service: blobs and kernels to the worker, results to the service.

link.py               HTTP client of the service
foreign_server.py     error sentence for an address that is not a farm's
trust.py              selects the TLS certificate to trust
cache.py              blobs by hash on this machine
kernels.py            download and upload of compiled kernels
ready.py              makes a kernel ready
kernel_precompile.py  compiles the next kernel in advance
results.py            sends events and sums on the Redis stream of results
errors.py             the errors, by their cause
retry.py              retries after failures of the worker or its connection
"""
