"""Attribution of errors, so that a fault of one job or worker does not stop the others.

bulkhead.py   isolates the faults of each job and scene
suspicion.py  detects workers that fail where others succeed
"""
