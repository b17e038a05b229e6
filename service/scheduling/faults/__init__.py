"""Attribution of errors, so that one job's or worker's fault does not stop the rest.

bulkhead.py   isolates the faults of each job and scene
suspicion.py  detects workers that fail where others succeed
"""
