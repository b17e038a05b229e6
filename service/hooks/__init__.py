"""Notifications to webhooks and to a program on the service's machine: ended or late jobs, and quarantined workers."""
