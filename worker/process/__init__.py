"""State shared by a worker's processes, and the order in which they take work.

context.py        shared state of a worker's processes
apply_terms.py    applies the terms that the service has set
queue_order.py    selects the next queue
queue_reading.py  reads the queue, and skips invalid messages
redis_lock.py     locks in Redis without scripts
"""
