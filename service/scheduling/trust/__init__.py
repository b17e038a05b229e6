"""Batches that two workers have rendered, held against each other.

trust.py  compares them, and throws out what a liar has sent
votes.py  decides who is right
"""
