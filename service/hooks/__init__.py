"""Notifications about the end of jobs: by webhook, or by a program on the service's machine."""
