"""What workers send back: read, validated, and merged into the film.

results.py        reads the stream of answers
messages.py       validates what workers say
merging.py        batches into the film
"""
