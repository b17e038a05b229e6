"""Log lines as JSON and OpenTelemetry traces, for the service and workers alike.

log_lines.py      log lines as JSON, with the ids of the work in progress
tracing.py        OpenTelemetry spans
trace_sender.py   the process that sends them
"""
