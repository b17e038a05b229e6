"""What every process of a worker knows, and how the worker keeps to its terms and takes turns.

context.py        what every process of a worker knows
apply_terms.py        keeps to the terms it was asked for
queue_order.py          from which queue it takes next
queue_reading.py  reads the queue, and skips what is no message
redis_lock.py     locks in Redis without scripts
"""
