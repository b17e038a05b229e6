"""Answers from workers: read, validated, and merged into the film.

results.py   reads the stream of answers
messages.py  validates the messages
merging.py   merges batches into the film
"""
