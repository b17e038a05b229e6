"""Reads untrusted files in a sandboxed child process.

rules.py          the sandbox enforced by the operating system: Landlock, a seccomp filter, no capabilities
syscalls.py       the system calls that the filter refuses, by processor
limits.py         memory, processor time and file size, never above what the caller already has
reader.py         the child: runs one job and sends messages over a pipe
launcher.py       the process that forks readers: no environment, no inherited descriptors, modules and kernels loaded once
running.py        the caller's side: starts jobs and receives their messages
faults.py         distinguishes errors caused by the machine from errors caused by the file
reader_errors.py  error messages for readers that fail
job_folder.py     the temporary folder of one job

Callers use only `running.py` and `job_folder.py`. If the operating system has neither Landlock nor seccomp, a reader
is only a separate process with limits and an empty environment.
"""
