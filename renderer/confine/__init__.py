"""Reading untrusted files in a child process that can do little else.

rules.py      what the kernel enforces: Landlock, a seccomp filter, no capabilities
syscalls.py   the system calls that the filter refuses, by processor
limits.py     memory, processor time and file size, never above what the caller already has
reader.py     the child: runs one job and reports over a pipe
launcher.py   the process that forks readers: no environment, no inherited descriptors, modules and kernels loaded once
running.py    the caller's side: starts jobs and takes their messages
faults.py     which errors are a machine's
endings.py    what comes of a reader that fails, as sentences
place.py      the temporary folder of one job

Only `running.py` and `place.py` are for callers. Where the kernel has neither Landlock nor seccomp, a reader is a process of its
own with limits and an empty environment, and nothing more.
"""
