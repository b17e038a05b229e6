"""JSON log lines and OpenTelemetry traces, for both the service and the workers.

log_lines.py      log lines as JSON, with the ids of the work in progress
tracing.py        records OpenTelemetry spans
trace_sender.py   the process that sends the spans
"""
