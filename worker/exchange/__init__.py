"""Data exchange between a worker and the service: blobs and kernels to the worker, results to the service.

link.py               HTTP client of the service
foreign_server.py     error messages for an address at which another server answers
trust.py              selects the TLS certificate to trust
cache.py              blobs by hash on this machine
kernels.py            download and upload of compiled kernels
ready.py              downloads or compiles a kernel
kernel_precompile.py  compiles the plain and the full-featured kernel in advance
results.py            sends events and sums on the Redis stream of results
sums_sender.py        sends a slot's sums in a thread while it renders
polling_thread.py     a thread that begins its tasks by itself, a little later
recall.py             whether the service has recalled a slot's message
chunked_socket.py     Redis connection whose timeout applies to each chunk of a large command
heartbeat_message.py  a heartbeat's commands to Redis, and the replies
errors.py             the errors, by their cause
retry.py              retries after failures of the worker or its connection
"""
