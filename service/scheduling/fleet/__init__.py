"""The workers: their reports, speeds and capabilities.

workers.py       the connected workers
reports.py       validates the workers' reports
speeds.py        speeds during the last hour
needs.py         requirements of jobs on their workers
dead_letters.py  messages from workers that could not be handled
"""
