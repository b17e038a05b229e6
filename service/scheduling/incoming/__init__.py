"""Results from workers: read, validated, and merged into films.

results.py   reads the stream of results
messages.py  validates the messages
merging.py   merges batches into the film
"""
