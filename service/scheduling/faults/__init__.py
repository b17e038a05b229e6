"""Whose fault an error is, so that everything else goes on.

bulkhead.py       keeps one job's faults from the others
suspicion.py      workers that fail where others do not
"""
