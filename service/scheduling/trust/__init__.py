"""Verification of batches by rendering them on two workers.

trust.py  compares the results, and removes the samples of a worker whose results were wrong
votes.py  decides which result is correct
"""
