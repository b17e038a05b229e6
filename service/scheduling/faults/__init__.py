"""Attribution of errors, so that a fault of one job or worker does not stop the others.

bulkhead.py      isolates the faults of each job and scene
redis_errors.py  errors of Redis, as sentences
repair.py        deletes Redis keys of the wrong type
suspicion.py     detects workers that fail where others succeed
"""
