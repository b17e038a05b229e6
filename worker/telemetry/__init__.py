"""A worker's own log and traces.

logs.py           set up the log
log_lines.py      log lines as JSON
log_tail.py       the end of the log, for the service
task_context.py           the ids of the task in progress
batch_warnings.py      a batch's warnings, and how long its steps took
tracing.py        OpenTelemetry spans
trace_sender.py   the process that sends them
"""
