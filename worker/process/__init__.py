"""State shared by a worker's processes, and the order in which they take work.

context.py        shared state of a worker's processes
apply_terms.py    applies the run-time settings that the service requires
queue_order.py    selects the next queue
queue_reading.py  reads the queue, and skips invalid messages
redis_lock.py     locks in Redis without scripts
slot_number.py    the number of the slot that a process is
"""
