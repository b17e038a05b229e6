"""Telling others when a job ends: by webhook, or by running a program of the farm's owner."""
